//! NUCLEO-G474RE: an STM32G474RE, Cortex-M4F, with a debug probe whose serial port connects to the
//! host.
//!
//! | pin | Arduino | signal |
//! |---|---|---|
//! | PA0, PA1, PB0 | A0, A1, A3 | ADC1: pressure, Pt1000, length; of a joint: pressures of a and b, angle |
//! | PA6, PA7 | D12, D11 | inlet and outlet coil, TIM3; of a joint: those of muscle a |
//! | PC8, PC9 | | those of muscle b, TIM3 |
//! | PB13, PB15, PB14, PB12, PC7 | | SPI2 of a MAX31865: SCK, MOSI, MISO, CS; its DRDY (D9), pulled up |
//! | PB2, PB1 | | CS and DRDY of the MAX31865 of muscle b |
//! | PA15, PB7 | | I2C1 of an MPR, or of a joint's AS5600: SCL, SDA; PB8 (D15) is BOOT0 |
//! | PA9 | D8 | brake of a joint |
//! | PA2, PA3 | | USART2, to the probe's serial port |
//! | PB5 | D4 | emergency stop, pulled down: open or low is stop |
//! | PA8 | D7 | fault output |
//! | PA5 | D13 | LED |

mod valves;

use super::{Adc, Board, Channel, Parts, Reset, WATCHDOG};
use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_embedded_hal::shared_bus::asynch::spi::SpiDevice;
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::Peri;
use embassy_stm32::adc::{self, AdcChannel, AdcConfig, AnyAdcChannel, SampleTime};
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::i2c::{self, I2c};
use embassy_stm32::interrupt::{self, InterruptExt, Priority};
use embassy_stm32::mode::Blocking;
#[cfg(feature = "joint")]
use embassy_stm32::pac::GPIOA;
use embassy_stm32::pac::{DBGMCU, IWDG, RCC, iwdg};
use embassy_stm32::peripherals::{ADC1, PA2, PA3, USART2};
use embassy_stm32::rcc;
use embassy_stm32::spi::mode::Master;
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{
    BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config as UartConfig,
};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::Duration;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use static_cell::StaticCell;
use thermyo_protocol::{BAUD, Chip};
use valves::{Coils, Timer3};

embassy_stm32::bind_interrupts!(struct Irqs {
    USART2 => BufferedInterruptHandler<USART2>;
});

/// Interrupt of an unused peripheral.
#[embassy_stm32::interrupt]
unsafe fn UART4() {
    // SAFETY: the interrupt that control's executor was started with.
    unsafe { crate::on_control_interrupt() }
}

/// SPI2, which the sensors' tasks share. A message of a few bytes blocks the thread, not control.
type SpiBus = BlockingAsync<Spi<'static, Blocking, Master>>;
/// I2C1, likewise; it gives up after [`I2C_TIMEOUT`], because the thread feeds the watchdog.
type I2cBus = BlockingAsync<I2c<'static, Blocking, i2c::Master>>;

/// Clock of SPI2: a MAX31865 allows up to 5 MHz.
const SPI_HZ: Hertz = Hertz(1_000_000);
const I2C_HZ: Hertz = Hertz(400_000);
/// The longest message, 8 bytes, takes 0.2 ms.
const I2C_TIMEOUT: Duration = Duration::from_millis(2);

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
    type GasBus = SpiDevice<'static, CriticalSectionRawMutex, SpiBus, Output<'static>>;
    type I2c = I2cBus;

    fn start() -> Parts<Self> {
        let p = embassy_stm32::init(clocks());
        let coils = Coils {
            a: (p.PA6, p.PA7),
            #[cfg(feature = "joint")]
            b: (p.PC8, p.PC9),
        };
        let valves = Timer3::new(p.TIM3, coils);

        let reset = reset();
        DBGMCU.apb1lfzr().modify(|halted| halted.set_iwdg(true));
        let mut watchdog = IndependentWatchdog::new(p.IWDG, WATCHDOG.as_micros() as u32);
        watchdog.unleash();

        let (sender, receiver) = serial(p.USART2, p.PA3, p.PA2);

        let mut spi_config = spi::Config::default();
        spi_config.mode = spi::MODE_1;
        spi_config.frequency = SPI_HZ;
        let spi = Spi::new_blocking(p.SPI2, p.PB13, p.PB15, p.PB14, spi_config);
        static SPI: StaticCell<Mutex<CriticalSectionRawMutex, SpiBus>> = StaticCell::new();
        let spi: &'static Mutex<_, _> = SPI.init(Mutex::new(BlockingAsync::new(spi)));
        let select = |pin| SpiDevice::new(spi, pin);
        let high = Level::High;
        let gas_buses = [
            (select(Output::new(p.PB12, high, Speed::Low)), Input::new(p.PC7, Pull::Up)),
            #[cfg(feature = "joint")]
            (select(Output::new(p.PB2, high, Speed::Low)), Input::new(p.PB1, Pull::Up)),
        ];
        let mut i2c_config = i2c::Config::default();
        i2c_config.frequency = I2C_HZ;
        i2c_config.timeout = I2C_TIMEOUT;
        let i2c = BlockingAsync::new(I2c::new_blocking(p.I2C1, p.PA15, p.PB7, i2c_config));

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
            #[cfg(feature = "joint")]
            brake_release: Some(Output::new(p.PA9, Level::Low, Speed::Low)),
            #[cfg(not(feature = "joint"))]
            brake_release: None,
            receiver,
            sender,
            gas_buses,
            i2c,
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
        valves::vent();
        #[cfg(feature = "joint")]
        GPIOA.bsrr().write(|pins| pins.set_br(9, true));
    }

    fn restart() -> ! {
        cortex_m::peripheral::SCB::sys_reset()
    }

    /// The debug probe flashes this board.
    const BOOT_LOADER: Option<fn() -> !> = None;
}

/// Sets up the serial line. Must be called only once.
fn serial(
    uart: Peri<'static, USART2>,
    rx: Peri<'static, PA3>,
    tx: Peri<'static, PA2>,
) -> (BufferedUartTx<'static>, BufferedUartRx<'static>) {
    static TX: StaticCell<[u8; 512]> = StaticCell::new();
    static RX: StaticCell<[u8; 512]> = StaticCell::new();
    let mut config = UartConfig::default();
    config.baudrate = BAUD;
    // Also delivers bytes that come without a pause.
    config.eager_reads = Some(32);
    let [tx_buffer, rx_buffer] = [&TX, &RX].map(|buffer| buffer.init_with(|| [0; 512]));
    let Ok(uart) = BufferedUart::new(uart, rx, tx, tx_buffer, rx_buffer, Irqs, config) else {
        panic!("the clock gives the line's rate");
    };
    // Above control, whose step takes longer than the receiver can buffer.
    interrupt::USART2.set_priority(Priority::P0);
    uart.split()
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

/// Reads and clears the reset cause. Every reset also sets the reset pin's flag, and power-on sets
/// the brown-out's.
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

/// This board has no store: its program runs from the flash that would have to be written.
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
