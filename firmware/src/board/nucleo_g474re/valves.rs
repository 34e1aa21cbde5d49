//! All valves, on TIM3. Its counter runs from 0 to [`TICKS`] - 1, or over the clocks of a carrier
//! period: the full duty is above the counter's top, always on.

use super::CLOCK_HZ;
use crate::board::{CARRIER_HZ, Modulation, Valves};
use crate::kind::{Commands, MUSCLES, PWM_DELAY, each};
use crate::source::STEP_US;
use embassy_stm32::Peri;
use embassy_stm32::gpio::OutputType;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{GPIOA, GPIOC};
use embassy_stm32::peripherals::{PA6, PA7, TIM3};
#[cfg(feature = "joint")]
use embassy_stm32::peripherals::{PC8, PC9};
use embassy_stm32::timer::low_level::{OutputCompareMode, Timer};
use embassy_stm32::timer::simple_pwm::PwmPin;
use embassy_stm32::timer::{Ch1, Ch2, Channel};
#[cfg(feature = "joint")]
use embassy_stm32::timer::{Ch3, Ch4};
use model_core::Command;

/// Counts of the timer per PWM period.
const TICKS: u16 = 50_000;

/// Timer clocks per tick of the counter, for each step of the period.
const CLOCKS_PER_STEP: u32 = {
    let clocks = CLOCK_HZ / 1_000_000 * STEP_US;
    let ticks = TICKS as u32;
    assert!(clocks.is_multiple_of(ticks));
    clocks / ticks
};

/// The prescaler divides by up to 65 536.
pub const MAXIMUM_PERIOD_STEPS: u16 = (65_536 / CLOCKS_PER_STEP) as u16;

/// Channels of inlet and outlet of each muscle: PA6 and PA7, PC8 and PC9.
const CHANNELS: [[Channel; 2]; 2] = [[Channel::Ch1, Channel::Ch2], [Channel::Ch3, Channel::Ch4]];

/// Forces both pins of a muscle low at once, or returns them to the timer. A level forced in the
/// timer itself would end only at a compare match: never, for a coil that is always on.
fn force_low(muscle: usize, low: bool) {
    // Their output registers have been low since reset.
    let mode = if low { Moder::OUTPUT } else { Moder::ALTERNATE };
    let (port, coils) = if muscle == 0 { (GPIOA, [6, 7]) } else { (GPIOC, [8, 9]) };
    port.moder().modify(|pins| coils.iter().for_each(|&pin| pins.set_moder(pin, mode)));
}

/// Forces the pins of all muscles low.
pub fn vent() {
    (0..MUSCLES).for_each(|muscle| force_low(muscle, true));
}

/// Kept, because dropping them releases the pins.
struct Pins {
    _a: (PwmPin<'static, TIM3, Ch1>, PwmPin<'static, TIM3, Ch2>),
    #[cfg(feature = "joint")]
    _b: (PwmPin<'static, TIM3, Ch3>, PwmPin<'static, TIM3, Ch4>),
}

/// Pins of inlet and outlet of muscle a, and of muscle b.
pub struct Coils {
    pub a: (Peri<'static, PA6>, Peri<'static, PA7>),
    #[cfg(feature = "joint")]
    pub b: (Peri<'static, PC8>, Peri<'static, PC9>),
}

pub struct Timer3 {
    timer: Timer<'static, TIM3>,
    _pins: Pins,
    forced_low: [bool; MUSCLES],
    /// Counts per period.
    ticks: u16,
}

impl Timer3 {
    /// Stops the timer and removes the power from all coils.
    pub fn new(timer: Peri<'static, TIM3>, coils: Coils) -> Self {
        let timer = Timer::new(timer);
        timer.regs_core().arr().write(|top| top.set_arr(TICKS - 1));
        for channel in CHANNELS.into_iter().take(MUSCLES).flatten() {
            timer.set_output_compare_mode(channel, OutputCompareMode::PwmMode1);
            // Compare values take effect where the counter wraps, so that no pulse is cut.
            timer.set_output_compare_preload(channel, true);
            timer.enable_channel(channel, true);
        }
        timer.generate_update_event();
        let output = OutputType::PushPull;
        let pins = Pins {
            _a: (PwmPin::new(coils.a.0, output), PwmPin::new(coils.a.1, output)),
            #[cfg(feature = "joint")]
            _b: (PwmPin::new(coils.b.0, output), PwmPin::new(coils.b.1, output)),
        };
        Self { timer, _pins: pins, forced_low: [false; MUSCLES], ticks: TICKS }
    }

    /// Sets the compare values of all channels, which take effect together.
    fn compare(&self, commands: [Command; MUSCLES]) {
        let cr1 = self.timer.regs_core().cr1();
        cr1.modify(|cr1| cr1.set_udis(true));
        for ([inlet, outlet], command) in CHANNELS.into_iter().zip(commands) {
            let coils = command.coils();
            self.timer.set_compare_value(inlet, coils.0.ticks(self.ticks));
            self.timer.set_compare_value(outlet, coils.1.ticks(self.ticks));
        }
        cr1.modify(|cr1| cr1.set_udis(false));
    }
}

impl Valves for Timer3 {
    fn restart(&mut self, modulation: Modulation, commands: Commands) {
        let (full, clocks, delay) = match modulation {
            Modulation::Pulses { period_steps } => {
                let steps = u32::from(period_steps.max(1));
                let delay = u32::from(TICKS) * PWM_DELAY.as_micros() as u32 / (steps * STEP_US);
                (u32::from(TICKS), CLOCKS_PER_STEP * steps, delay)
            }
            Modulation::Carrier => (CLOCK_HZ / CARRIER_HZ, 1, 1),
        };
        self.ticks = full as u16;
        let registers = self.timer.regs_core();
        self.timer.stop();
        registers.psc().write_value((clocks - 1) as u16);
        registers.arr().write(|top| top.set_arr(self.ticks - 1));
        // Loads the prescaler and sets the counter to zero.
        self.timer.generate_update_event();
        registers.cnt().write(|counter| counter.set_cnt((full - delay.max(1)) as u16));
        self.timer.start();
        self.drive(commands);
    }

    fn drive(&mut self, commands: Commands) {
        let commands = each(commands);
        for (muscle, (command, forced_low)) in commands.iter().zip(&mut self.forced_low).enumerate()
        {
            // The pin's mode acts at once and keeps the PWM's phase.
            let low = *command == Command::VENT;
            if low != *forced_low {
                force_low(muscle, low);
                *forced_low = low;
            }
        }
        self.compare(commands);
    }
}
