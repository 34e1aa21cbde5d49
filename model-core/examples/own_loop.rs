//! Your own loop on a PC: the core holds 2.5 bar in a simulated muscle. Another plant, or a real
//! one, can replace `muscle`.

use model_core::forward_model::Model;
use model_core::physics::gas::Reservoir;
use model_core::sample::CODE_MAX;
use model_core::{AdcCode, Config, Core, Sample, SetPoint};

/// The first code that reads at least `value`.
fn code(value: f32, reading: impl Fn(AdcCode) -> f32) -> AdcCode {
    let (mut low, mut high) = (0, CODE_MAX);
    while low < high {
        let middle = low + (high - low) / 2;
        if reading(AdcCode(middle)) < value { low = middle + 1 } else { high = middle }
    }
    AdcCode(low)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let config = Config::default();
    let sensing = config.sensing();
    let mut core = Core::new(&config)?;
    core.set(SetPoint::Pressure { pressure_pa: 2.5e5 })?;
    let (supply, ambient) = (config.supply, config.ambient);
    let mut muscle = Model::new(&config, ambient.pressure_pa, ambient.temperature_k, 0.3)?;
    for step in 0..1000_u32 {
        // A channel without any noise counts as broken.
        let noisy = |code: AdcCode| AdcCode(code.0 + (step % 2) as u16);
        let sample = Sample::new(
            noisy(code(muscle.pressure_pa(), |code| sensing.pressure_pa(code))),
            code(muscle.sensor_k(), |code| sensing.gas_k(code)),
            noisy(code(muscle.length_m(), |code| sensing.length_m(code))),
        );
        let telemetry = core.step(&sample);
        if step % 100 == 0 {
            println!(
                "{step:4} ms  {:.3} bar, {:.1} K estimated, {:.1} K true, {}",
                muscle.pressure_pa() / 1.0e5,
                telemetry.estimate.gas_k,
                muscle.gas_k(),
                telemetry.faults,
            );
        }
        let pressure_pa = muscle.pressure_pa();
        let open = telemetry.command;
        let inflow_kg_s = open.inlet.share()
            * config.valve.mass_flow_kg_s(&config.gas, supply.into(), pressure_pa);
        let inside = Reservoir { pressure_pa, temperature_k: muscle.gas_k() };
        let outflow_kg_s = open.outlet.share()
            * config.valve.mass_flow_kg_s(&config.gas, inside, ambient.pressure_pa);
        muscle.step(inflow_kg_s, outflow_kg_s, None);
    }
    Ok(())
}
