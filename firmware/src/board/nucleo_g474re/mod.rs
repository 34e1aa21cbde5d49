//! NUCLEO-G474RE: an STM32G474RE, Cortex-M4F, with a debug probe whose serial port is the line to
//! the host.
//!
//! | pin | Arduino | signal |
//! |---|---|---|
//! | PA0, PA1, PB0 | A0, A1, A3 | ADC1: pressure, Pt1000, length |
//! | PA6, PA7 | D12, D11 | inlet and outlet coil, TIM3 |
//! | PA2, PA3 | | USART2, to the probe's serial port |
//! | PB5 | D4 | emergency stop, pulled down: open or low is stop |
//! | PA8 | D7 | fault output |
//! | PA5 | D13 | LED |

mod valves;

use super::{Adc, Board, Channel, Parts, Reset, WATCHDOG};
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::adc::{self, AdcChannel, AdcConfig, AnyAdcChannel, SampleTime};
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::interrupt::{self, InterruptExt, Priority};
use embassy_stm32::pac::{DBGMCU, IWDG, RCC, iwdg};
use embassy_stm32::peripherals::{ADC1, USART2};
use embassy_stm32::rcc;
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{
    BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config as UartConfig,
};
use embassy_stm32::wdg::IndependentWatchdog;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use static_cell::StaticCell;
use thermyo_protocol::{BAUD, Chip};
use valves::Timer3;

embassy_stm32::bind_interrupts!(struct Irqs {
    USART2 => BufferedInterruptHandler<USART2>;
});

/// The interrupt of a peripheral that is not used.
#[embassy_stm32::interrupt]
unsafe fn UART4() {
    // SAFETY: the interrupt that control's executor was started with.
    unsafe { crate::on_control_interrupt() }
}

/// Clock of the system and of all timers \[Hz\]: a millisecond is a whole number of PWM ticks.
const CLOCK_HZ: u32 = 150_000_000;

pub struct NucleoG474re;

impl Board for NucleoG474re {
    const CHIP: Chip = Chip::Stm32G474;

    fn maximum_period_steps() -> u16 {
        valves::MAXIMUM_PERIOD_STEPS
    }

    type Adc = Converter;
    type Valves = Timer3;
    type Flash = NoFlash;
    type Input = Input<'static>;
    type Output = Output<'static>;
    type Receiver = BufferedUartRx<'static>;
    type Sender = BufferedUartTx<'static>;

    fn start() -> Parts<Self> {
        let p = embassy_stm32::init(clocks());
        let valves = Timer3::new(p.TIM3, p.PA6, p.PA7);

        let reset = reset();
        DBGMCU.apb1lfzr().modify(|halted| halted.set_iwdg(true));
        let mut watchdog = IndependentWatchdog::new(p.IWDG, WATCHDOG.as_micros() as u32);
        watchdog.unleash();

        static TX: StaticCell<[u8; 512]> = StaticCell::new();
        static RX: StaticCell<[u8; 512]> = StaticCell::new();
        let mut uart_config = UartConfig::default();
        uart_config.baudrate = BAUD;
        // Also delivers bytes that come without a pause.
        uart_config.eager_reads = Some(32);
        let Ok(uart) = BufferedUart::new(
            p.USART2,
            p.PA3,
            p.PA2,
            TX.init_with(|| [0; 512]),
            RX.init_with(|| [0; 512]),
            Irqs,
            uart_config,
        ) else {
            panic!("the clock gives the line's rate");
        };
        let (sender, receiver) = uart.split();
        // Above control, whose step takes longer than the receiver can buffer.
        interrupt::USART2.set_priority(Priority::P0);

        Parts {
            reset,
            adc: Converter {
                adc: adc::Adc::new(p.ADC1, AdcConfig::default()),
                pressure: p.PA0.degrade_adc(),
                gas: p.PA1.degrade_adc(),
                length: p.PB0.degrade_adc(),
            },
            run_line: Input::new(p.PB5, Pull::Down),
            valves,
            flash: None,
            led: Output::new(p.PA5, Level::Low, Speed::Low),
            fault_output: Output::new(p.PA8, Level::Low, Speed::Low),
            brake_release: None,
            receiver,
            sender,
        }
    }

    fn start_control(executor: &'static InterruptExecutor) -> SendSpawner {
        interrupt::UART4.set_priority(Priority::P1);
        executor.start(interrupt::UART4)
    }

    fn feed() {
        IWDG.kr().write(|key| key.set_key(iwdg::vals::Key::RESET));
    }

    fn vent() {
        valves::force_low(true);
    }

    fn restart() -> ! {
        cortex_m::peripheral::SCB::sys_reset()
    }

    /// The debug probe flashes this board.
    const BOOT_LOADER: Option<fn() -> !> = None;
}

/// 150 MHz from the 24 MHz crystal, also for the converter.
fn clocks() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(rcc::Hse { freq: Hertz(24_000_000), mode: rcc::HseMode::Oscillator });
    config.rcc.pll = Some(rcc::Pll {
        source: rcc::PllSource::HSE,
        prediv: rcc::PllPreDiv::DIV4,
        mul: rcc::PllMul::MUL50,
        divp: None,
        divq: None,
        divr: Some(rcc::PllRDiv::DIV2),
    });
    config.rcc.sys = rcc::Sysclk::PLL1_R;
    config.rcc.mux.adc12sel = rcc::mux::Adcsel::SYS;
    config
}

/// Reads and clears the reset cause. Every reset also sets the flag of the reset pin, and power-on
/// sets that of the brown-out.
fn reset() -> Reset {
    let flags = RCC.csr().read();
    RCC.csr().modify(|csr| csr.set_rmvf(true));
    if flags.borrstf() {
        Reset::Power
    } else if flags.iwdgrstf() {
        Reset::TimedOut
    } else if flags.sftrstf() {
        Reset::Forced
    } else {
        Reset::Power
    }
}

pub struct Converter {
    adc: adc::Adc<'static, ADC1>,
    pressure: AnyAdcChannel<'static, ADC1>,
    gas: AnyAdcChannel<'static, ADC1>,
    length: AnyAdcChannel<'static, ADC1>,
}

impl Adc for Converter {
    fn convert(&mut self, channel: Channel) -> u16 {
        let channel = match channel {
            Channel::Adc0 => &mut self.pressure,
            Channel::Adc1 => &mut self.gas,
            Channel::Adc2 => &mut self.length,
        };
        // 1.6 us at 37.5 MHz, with the conversion.
        self.adc.blocking_read(channel, SampleTime::CYCLES47_5)
    }
}

/// This board has no store: its program runs from the flash that would be written.
pub enum NoFlash {}

impl ErrorType for NoFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for NoFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, _: u32, _: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        match *self {}
    }

    fn capacity(&self) -> usize {
        match *self {}
    }
}

impl NorFlash for NoFlash {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = super::STORE_BYTES / 4;

    async fn erase(&mut self, _: u32, _: u32) -> Result<(), NorFlashErrorKind> {
        match *self {}
    }

    async fn write(&mut self, _: u32, _: &[u8]) -> Result<(), NorFlashErrorKind> {
        match *self {}
    }
}
