//! Both valves, on TIM3. Its counter runs from 0 to [`TICKS`] - 1, or over the clocks of a period of the
//! carrier: the full duty is above the counter's top, always on.

use super::CLOCK_HZ;
use crate::board::{CARRIER_HZ, Modulation, Valves};
use crate::kind::PWM_DELAY;
use crate::source::STEP_US;
use embassy_stm32::Peri;
use embassy_stm32::gpio::OutputType;
use embassy_stm32::pac::GPIOA;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::peripherals::{PA6, PA7, TIM3};
use embassy_stm32::timer::low_level::{OutputCompareMode, Timer};
use embassy_stm32::timer::simple_pwm::PwmPin;
use embassy_stm32::timer::{Ch1, Ch2, Channel};
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

// PA6 and PA7.
const COIL_PINS: [usize; 2] = [6, 7];

/// Forces both pins low at once, or gives them back to the timer. A level forced in the timer
/// itself would end only when its comparison changes: never, for a coil that is always on.
pub fn force_low(low: bool) {
    // Their output registers are low since reset.
    let mode = if low { Moder::OUTPUT } else { Moder::ALTERNATE };
    GPIOA.moder().modify(|pins| COIL_PINS.iter().for_each(|&pin| pins.set_moder(pin, mode)));
}

pub struct Timer3 {
    timer: Timer<'static, TIM3>,
    /// Kept, because dropping them releases the pins.
    _pins: (PwmPin<'static, TIM3, Ch1>, PwmPin<'static, TIM3, Ch2>),
    forced_low: bool,
    /// Counts per period.
    ticks: u16,
}

impl Timer3 {
    /// The timer is stopped, and both coils are without power.
    pub fn new(
        timer: Peri<'static, TIM3>,
        inlet: Peri<'static, PA6>,
        outlet: Peri<'static, PA7>,
    ) -> Self {
        let timer = Timer::new(timer);
        timer.regs_core().arr().write(|top| top.set_arr(TICKS - 1));
        for channel in [Channel::Ch1, Channel::Ch2] {
            timer.set_output_compare_mode(channel, OutputCompareMode::PwmMode1);
            // Compare values take effect where the counter wraps, so that no pulse is cut.
            timer.set_output_compare_preload(channel, true);
            timer.enable_channel(channel, true);
        }
        timer.generate_update_event();
        let pins =
            (PwmPin::new(inlet, OutputType::PushPull), PwmPin::new(outlet, OutputType::PushPull));
        Self { timer, _pins: pins, forced_low: false, ticks: TICKS }
    }

    /// Sets the compare values of both channels, which take effect together.
    fn compare(&self, command: Command) {
        let (inlet, outlet) = command.coils();
        let cr1 = self.timer.regs_core().cr1();
        cr1.modify(|cr1| cr1.set_udis(true));
        self.timer.set_compare_value(Channel::Ch1, inlet.ticks(self.ticks));
        self.timer.set_compare_value(Channel::Ch2, outlet.ticks(self.ticks));
        cr1.modify(|cr1| cr1.set_udis(false));
    }
}

impl Valves for Timer3 {
    fn restart(&mut self, modulation: Modulation, command: Command) {
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
        self.drive(command);
    }

    fn drive(&mut self, command: Command) {
        // The pin's mode acts at once and keeps the PWM's phase.
        let low = command == Command::VENT;
        if low != self.forced_low {
            force_low(low);
            self.forced_low = low;
        }
        self.compare(command);
    }
}
