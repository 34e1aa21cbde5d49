//! Raspberry Pi Pico (RP2040) and Pico 2 (RP2350): the same pins, the same peripherals.
//!
//! | pin | signal |
//! |---|---|
//! | GP26, GP27, GP28 | ADC: pressure, Pt1000, length |
//! | GP16, GP17 | inlet and outlet coil, PWM slice 0 |
//! | GP0, GP1 | UART0 |
//! | GP14 | emergency stop, pulled down: open or low is stop |
//! | GP15, GP25 | fault output, LED |

use super::{BlackBox, PWM_DELAY, Valves};
use crate::shared::Shared;
use crate::source::{self, STEP};
use crate::{control, link, supervisor};
use core::panic::PanicInfo;
use cortex_m_rt::ExceptionFrame;
use defmt_rtt as _;
use embassy_executor::{Executor, InterruptExecutor};
use embassy_rp::clocks::clk_sys_freq;
use embassy_rp::gpio::{Level, Output};
use embassy_rp::interrupt::{self, InterruptExt, Priority};
use embassy_rp::pac::IO_BANK0;
use embassy_rp::pac::io::vals::Outover;
use embassy_rp::peripherals::{PIN_16, PIN_17, UART0, WATCHDOG};
use embassy_rp::pwm::{Config as PwmConfig, Pwm};
use embassy_rp::uart::{
    BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config as UartConfig,
};
use embassy_rp::watchdog::{ResetReason, Watchdog};
use embassy_time::{Duration, Instant};
use model_core::link::{BAUD, Chip, LastReset, Phase};
use model_core::safety::supervisor::FirstFailure;
use model_core::{Command, Core, Duty, Faults};
use static_cell::StaticCell;

const CHIP: Chip = if cfg!(feature = "pico2") { Chip::Rp2350 } else { Chip::Rp2040 };

embassy_rp::bind_interrupts!(struct Irqs {
    UART0_IRQ => BufferedInterruptHandler<UART0>;
});

defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

static SHARED: Shared = Shared::new();
static CONTROL: InterruptExecutor = InterruptExecutor::new();

#[embassy_rp::interrupt]
unsafe fn SWI_IRQ_1() {
    // SAFETY: the interrupt that the executor was started with.
    unsafe { CONTROL.on_interrupt() }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let p = embassy_rp::init(embassy_rp::config::Config::default());
    // Both coils without power, before anything else.
    let valves =
        RpValves::new(Pwm::new_output_ab(p.PWM_SLICE0, p.PIN_16, p.PIN_17, RpValves::off()));

    let mut watchdog = Watchdog::new(p.WATCHDOG);
    let (last_reset, remembered) = recall(&mut watchdog);
    watchdog.pause_on_debug(true);
    watchdog.start(supervisor::WATCHDOG);
    let [major, minor, patch] = link::FIRMWARE;
    defmt::info!("thermyo firmware {}.{}.{}", major, minor, patch);

    static TX: StaticCell<[u8; 512]> = StaticCell::new();
    static RX: StaticCell<[u8; 512]> = StaticCell::new();
    let mut uart_config = UartConfig::default();
    uart_config.baudrate = BAUD;
    let uart = BufferedUart::new(
        p.UART0,
        p.PIN_0,
        p.PIN_1,
        Irqs,
        TX.init_with(|| [0; 512]),
        RX.init_with(|| [0; 512]),
        uart_config,
    );
    let (tx, rx) = uart.split();
    // Above control, whose step is longer than the receiver's buffer lasts.
    interrupt::UART0_IRQ.set_priority(Priority::P0);

    #[cfg(not(feature = "hil"))]
    let source = source::Inputs::new(
        converter::Converter::new(p.ADC, p.PIN_26, p.PIN_27, p.PIN_28),
        embassy_rp::gpio::Input::new(p.PIN_14, embassy_rp::gpio::Pull::Down),
    );
    #[cfg(feature = "hil")]
    let source = source::Host::new(&SHARED);

    // SAFETY: control has the scratch registers, the supervisor the rest of the watchdog.
    let recorder = Recorder {
        watchdog: Watchdog::new(unsafe { WATCHDOG::steal() }),
        phase: Phase::Starting,
        latched: remembered.map_or(Faults::NONE, |(_, latched)| latched),
    };
    let led = Output::new(p.PIN_25, Level::Low);
    let fault_output = Output::new(p.PIN_15, Level::Low);
    let identity =
        link::Identity { chip: CHIP, last_reset, maximum_period_steps: RpValves::maximum_steps() };

    interrupt::SWI_IRQ_1.set_priority(Priority::P1);
    let control = CONTROL.start(interrupt::SWI_IRQ_1);
    static THREAD: StaticCell<Executor> = StaticCell::new();
    THREAD.init_with(Executor::new).run(|thread| {
        let (Ok(send), Ok(receive), Ok(supervise), Ok(step)) = (
            send(tx),
            receive(rx, identity),
            supervise(watchdog, led, fault_output, last_reset),
            step(source, valves, recorder, remembered),
        ) else {
            panic!("each task is started once");
        };
        thread.spawn(send);
        thread.spawn(receive);
        thread.spawn(supervise);
        control.spawn(step);
    })
}

#[cfg(not(feature = "hil"))]
type Source = source::Inputs<converter::Converter, embassy_rp::gpio::Input<'static>>;
#[cfg(feature = "hil")]
type Source = source::Host;

#[embassy_executor::task]
async fn step(source: Source, valves: RpValves, recorder: Recorder, remembered: Remembered) -> ! {
    let Ok(mut core) = Core::unconfigured() else {
        panic!("the default configuration holds");
    };
    if let Some((first, latched)) = remembered {
        core.recall(first, latched);
    }
    control::run(core, source, valves, recorder, &SHARED).await
}

#[embassy_executor::task]
async fn send(tx: BufferedUartTx) -> ! {
    link::send(tx, &SHARED).await
}

#[embassy_executor::task]
async fn receive(rx: BufferedUartRx, identity: link::Identity) -> ! {
    link::receive(rx, identity, &SHARED).await
}

#[embassy_executor::task]
async fn supervise(
    watchdog: Watchdog,
    led: Output<'static>,
    fault_output: Output<'static>,
    last_reset: LastReset,
) -> ! {
    supervisor::run(RpWatchdog(watchdog), led, fault_output, last_reset, &SHARED).await
}

/// PWM slice 0. Its counter runs from 0 to 49 999, so that a duty is its compare value, and 100 %
/// is above the counter's top: always on.
struct RpValves {
    pwm: Pwm<'static>,
    config: PwmConfig,
    over: Outover,
}

/// GP16 and GP17.
const INLET_PIN: usize = 16;
const OUTLET_PIN: usize = 17;

impl RpValves {
    fn new(pwm: Pwm<'static>) -> Self {
        Self { pwm, config: Self::off(), over: Outover::NORMAL }
    }

    fn off() -> PwmConfig {
        let mut config = PwmConfig::default();
        config.top = Duty::FULL.ticks() - 1;
        config.enable = false;
        config
    }

    /// Divider of the system clock, in sixteenths, with which the counter takes `steps`. Exact for
    /// every whole number of milliseconds at 125 MHz and at 150 MHz.
    fn divider_sixteenths(steps: u16) -> u64 {
        let clocks = u64::from(clk_sys_freq()) * STEP.as_micros() * u64::from(steps) / 1_000_000;
        16 * clocks / u64::from(Duty::FULL.ticks())
    }

    /// The divider has eight bits before the point and four behind.
    fn maximum_steps() -> u16 {
        (0xfff / Self::divider_sixteenths(1)) as u16
    }

    fn set_coils(&mut self, command: Command) {
        let (inlet, outlet) = command.coils();
        self.config.compare_a = inlet.ticks();
        self.config.compare_b = outlet.ticks();
    }
}

impl Valves for RpValves {
    fn restart(&mut self, period_steps: u16, command: Command) {
        self.config.enable = false;
        self.pwm.set_config(&self.config);
        self.config.divider =
            fixed::FixedU16::from_bits(Self::divider_sixteenths(period_steps) as u16);
        let delay = u64::from(Duty::FULL.ticks()) * PWM_DELAY.as_micros()
            / (u64::from(period_steps.max(1)) * STEP.as_micros());
        self.pwm.set_counter((u64::from(Duty::FULL.ticks()) - delay.max(1)) as u16);
        self.config.enable = true;
        self.pwm.set_config(&self.config);
        self.drive(command);
    }

    fn drive(&mut self, command: Command) {
        let before = (self.config.compare_a, self.config.compare_b);
        self.set_coils(command);
        // A pad's override acts at once, and the PWM's phase stays.
        let over = if command == Command::VENT { Outover::LOW } else { Outover::NORMAL };
        if over != self.over {
            for pin in [INLET_PIN, OUTLET_PIN] {
                IO_BANK0.gpio(pin).ctrl().modify(|ctrl| ctrl.set_outover(over));
            }
            self.over = over;
        }
        if (self.config.compare_a, self.config.compare_b) != before {
            // Compare values are taken over where the counter wraps: a pulse is never cut.
            self.pwm.set_config(&self.config);
        }
    }
}

struct RpWatchdog(Watchdog);

impl super::Watchdog for RpWatchdog {
    fn feed(&mut self, timeout: Duration) {
        self.0.feed(timeout);
    }
}

/// The watchdog's scratch registers outlive every restart but that of the power.
struct Recorder {
    watchdog: Watchdog,
    phase: Phase,
    latched: Faults,
}

/// Scratch registers in use; the boot ROM reads the upper four. The phase has the lowest byte of
/// [`STATE`], the cause of a restart the next one, the latched faults the upper half.
const STATE: usize = 0;
const DETAIL: usize = 1;
/// 1 hPa \[Pa\].
const PA_PER_HPA: f32 = 100.0;
/// Faults of the first failure, and above them its pressure in hectopascals.
const FAILURE: usize = 2;
const FAILURE_STEP: usize = 3;
const PANIC: u32 = 1;
const HARD_FAULT: u32 = 2;

const PHASES: [Phase; 5] =
    [Phase::Starting, Phase::Waiting, Phase::Sampling, Phase::Stepping, Phase::Driving];

impl BlackBox for Recorder {
    fn note(&mut self, phase: Phase) {
        self.phase = phase;
        self.watchdog.set_scratch(STATE, phase as u32 | u32::from(self.latched.0) << 16);
    }

    fn record(&mut self, first: Option<FirstFailure>, latched: Faults) {
        if let Some(FirstFailure { faults, pressure_pa, step }) = first {
            let pressure_hpa = (pressure_pa / PA_PER_HPA) as u16;
            let failure = u32::from(faults.0) | u32::from(pressure_hpa) << 16;
            self.watchdog.set_scratch(FAILURE, failure);
            self.watchdog.set_scratch(FAILURE_STEP, step);
        }
        self.latched = latched;
        self.note(self.phase);
    }
}

/// What vented before the restart, and what was latched then.
type Remembered = Option<(FirstFailure, Faults)>;

/// Why the board started, and what it was latched for; the registers are then ready for the next time.
fn recall(watchdog: &mut Watchdog) -> (LastReset, Remembered) {
    let [state, detail, failure, step] =
        [STATE, DETAIL, FAILURE, FAILURE_STEP].map(|register| watchdog.get_scratch(register));
    let phase = *PHASES.get((state & 0xff) as usize).unwrap_or(&Phase::Starting);
    let cause = state >> 8 & 0xff;
    let last_reset = match (watchdog.reset_reason(), cause) {
        (Some(ResetReason::Forced), PANIC) => LastReset::Panic { line: detail, phase },
        (Some(ResetReason::Forced), HARD_FAULT) => LastReset::HardFault { address: detail, phase },
        (Some(ResetReason::TimedOut), _) => LastReset::Watchdog { phase },
        _ => LastReset::Power,
    };
    if last_reset != LastReset::Power {
        defmt::warn!("restarted in phase {=u32}, cause {=u32}", phase as u32, cause);
    }
    let faults = Faults(failure as u16);
    let latched = Faults((state >> 16) as u16);
    let pressure_pa = (failure >> 16) as f32 * PA_PER_HPA;
    let first = FirstFailure { faults, pressure_pa, step };
    // Power clears the registers.
    let remembered = (faults != Faults::NONE).then_some((first, latched));
    watchdog.set_scratch(STATE, Phase::Starting as u32 | state & 0xffff_0000);
    (last_reset, remembered)
}

/// Vents, leaves a note for after the restart, restarts.
fn give_up(cause: u32, detail: u32) -> ! {
    cortex_m::interrupt::disable();
    // SAFETY: nothing else runs any more.
    let (inlet, outlet, watchdog) =
        unsafe { (PIN_16::steal(), PIN_17::steal(), WATCHDOG::steal()) };
    let _coils = (Output::new(inlet, Level::Low), Output::new(outlet, Level::Low));
    let mut watchdog = Watchdog::new(watchdog);
    let state = watchdog.get_scratch(STATE);
    watchdog.set_scratch(STATE, state & 0xffff_00ff | cause << 8);
    watchdog.set_scratch(DETAIL, detail);
    watchdog.trigger_reset();
    loop {
        cortex_m::asm::nop();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    let (file, line) = info.location().map_or(("?", 0), |place| (place.file(), place.line()));
    defmt::error!("panic at {=str}:{=u32}", file, line);
    give_up(PANIC, line)
}

#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    give_up(HARD_FAULT, frame.pc())
}

#[cfg(not(feature = "hil"))]
mod converter {
    use crate::board::{Adc, Channel};
    use embassy_rp::Peri;
    use embassy_rp::adc::{self, Blocking};
    use embassy_rp::gpio::Pull;
    use embassy_rp::peripherals::{ADC, PIN_26, PIN_27, PIN_28};

    /// Single conversions in turn.
    pub struct Converter {
        adc: adc::Adc<'static, Blocking>,
        pressure: adc::Channel<'static>,
        gas: adc::Channel<'static>,
        length: adc::Channel<'static>,
    }

    impl Converter {
        pub fn new(
            adc: Peri<'static, ADC>,
            pressure: Peri<'static, PIN_26>,
            gas: Peri<'static, PIN_27>,
            length: Peri<'static, PIN_28>,
        ) -> Self {
            Self {
                adc: adc::Adc::new_blocking(adc, adc::Config::default()),
                pressure: adc::Channel::new_pin(pressure, Pull::None),
                gas: adc::Channel::new_pin(gas, Pull::None),
                length: adc::Channel::new_pin(length, Pull::None),
            }
        }
    }

    impl Adc for Converter {
        fn convert(&mut self, channel: Channel) -> u16 {
            let channel = match channel {
                Channel::Pressure => &mut self.pressure,
                Channel::Gas => &mut self.gas,
                Channel::Length => &mut self.length,
            };
            // A failed conversion reads as a broken sensor, which the core's supervisor knows.
            self.adc.blocking_read(channel).unwrap_or(0)
        }
    }
}
