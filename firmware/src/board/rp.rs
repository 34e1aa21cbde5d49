//! Common code of Raspberry Pi Pico (RP2040) and Pico 2 (RP2350): the same pins and peripherals.
//!
//! | pin | signal |
//! |---|---|
//! | GP26, GP27, GP28 | ADC: pressure, Pt1000, length; of a joint: pressures of a and b, angle |
//! | GP16, GP17 | inlet and outlet coil, PWM slice 0; of a joint: those of muscle a |
//! | GP18, GP19 | those of muscle b, PWM slice 1 |
//! | GP0, GP1 | UART0 |
//! | GP10, GP11, GP12, GP13, GP9 | SPI1 of a MAX31865: SCK, MOSI, MISO, CS; its DRDY, pulled up |
//! | GP7, GP8 | CS and DRDY of the MAX31865 of muscle b |
//! | GP4, GP5 | I2C0 of an MPR, or of a joint's AS5600: SDA, SCL |
//! | GP14 | emergency stop, pulled down here and by the board (erratum RP2350-E9): low is stop |
//! | GP15, GP25 | fault output, LED |
//! | USB | the same link as on UART0 |

use super::rp_bus::{I2cBus, SpiDevice};
use super::rp_flash::StoreFlash;
use super::{Adc, Board, CARRIER_HZ, Channel, Modulation, Parts, Reset, Valves, WATCHDOG};
use crate::kind::{Commands, MUSCLES, PWM_DELAY, each};
use crate::source::STEP_US;
use core::marker::PhantomData;
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_rp::adc::{self, Blocking};
use embassy_rp::clocks::{ClockConfig, clk_sys_freq};
use embassy_rp::gpio::{Input, Level, Output, Pull};
use embassy_rp::interrupt::{self, InterruptExt, Priority};
// The interrupt of embassy's timer.
#[cfg(not(feature = "pico2"))]
use embassy_rp::interrupt::TIMER_IRQ_0 as TIMER_IRQ;
#[cfg(feature = "pico2")]
use embassy_rp::interrupt::TIMER0_IRQ_0 as TIMER_IRQ;
use embassy_rp::pac::{self, io::vals::Outover};
use embassy_rp::peripherals::{self, FLASH, PIN_16, PIN_17, UART0, USB};
#[cfg(feature = "joint")]
use embassy_rp::peripherals::{PIN_18, PIN_19, PIN_20};
use embassy_rp::pwm::{Config as PwmConfig, Pwm};
use embassy_rp::spi::{self, Spi};
use embassy_rp::uart::{
    BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config as UartConfig,
};
use embassy_rp::watchdog::{ResetReason, Watchdog};
use embassy_rp::{Peri, usb};
use model_core::Command;
use static_cell::StaticCell;
use thermyo_protocol::{BAUD, Chip};

embassy_rp::bind_interrupts!(struct Irqs {
    UART0_IRQ => BufferedInterruptHandler<UART0>;
    USBCTRL_IRQ => usb::InterruptHandler<USB>;
});

#[embassy_rp::interrupt]
unsafe fn SWI_IRQ_1() {
    // SAFETY: the interrupt that control's executor was started with.
    unsafe { crate::on_control_interrupt() }
}

/// Frequency of the crystal on both boards.
pub const CRYSTAL_HZ: u32 = 12_000_000;

/// Differences between the boards.
pub trait Member {
    const CHIP: Chip;
    /// Clocks of the chip, from its crystal.
    fn clocks() -> ClockConfig;
    /// Unique number of the board; zeros if it cannot be read.
    fn unique_id(flash: Peri<'_, FLASH>) -> [u8; 8];
    /// Restarts the chip into the boot ROM as if BOOTSEL were pressed.
    fn boot_loader() -> !;
}

pub struct Rp<M>(PhantomData<M>);

impl<M: Member> Board for Rp<M> {
    const CHIP: Chip = M::CHIP;

    /// The PWM's divider has eight integer bits and four fractional bits.
    fn maximum_period_steps() -> u16 {
        (0xfff / divider_sixteenths(1)) as u16
    }

    type Adc = Converter;
    type Valves = Slices;
    type Flash = StoreFlash;
    type Input = Input<'static>;
    type Output = Output<'static>;
    type Receiver = BufferedUartRx;
    type Sender = BufferedUartTx;
    type Usb = usb::Driver<'static, USB>;
    type GasBus = SpiDevice;
    type I2c = I2cBus;

    fn start() -> Parts<Self> {
        vectors_to_ram();
        let mut p = embassy_rp::init(embassy_rp::config::Config::new(M::clocks()));
        let off = Slice::off;
        let valves = Slices::new([
            Pwm::new_output_ab(p.PWM_SLICE0, p.PIN_16, p.PIN_17, off()),
            #[cfg(feature = "joint")]
            Pwm::new_output_ab(p.PWM_SLICE1, p.PIN_18, p.PIN_19, off()),
        ]);

        let mut watchdog = Watchdog::new(p.WATCHDOG);
        let reset = match watchdog.reset_reason() {
            Some(ResetReason::Forced) => Reset::Forced,
            Some(ResetReason::TimedOut) => Reset::TimedOut,
            None => Reset::Power,
        };
        watchdog.pause_on_debug(true);
        watchdog.start(WATCHDOG);

        let (sender, receiver) = serial(p.UART0, p.PIN_0, p.PIN_1);
        let usb = usb::Driver::new(p.USB, Irqs);
        // Below control: the USB host waits.
        interrupt::USBCTRL_IRQ.set_priority(Priority::P2);

        let mut spi_config = spi::Config::default();
        spi_config.phase = spi::Phase::CaptureOnSecondTransition;
        // Only its setup is used; the messages bypass embassy's driver.
        let _spi = Spi::new_blocking(p.SPI1, p.PIN_10, p.PIN_11, p.PIN_12, spi_config);
        let ready_a = Input::new(p.PIN_9, Pull::Up);
        let gas_buses = [
            (SpiDevice::new(Output::new(p.PIN_13, Level::High)), ready_a),
            #[cfg(feature = "joint")]
            (SpiDevice::new(Output::new(p.PIN_7, Level::High)), Input::new(p.PIN_8, Pull::Up)),
        ];
        let i2c = I2cBus::new(p.I2C0, p.PIN_5, p.PIN_4);

        let unique_id = M::unique_id(p.FLASH.reborrow());
        Parts {
            reset,
            adc: Converter {
                adc: adc::Adc::new_blocking(p.ADC, adc::Config::default()),
                pressure: adc::Channel::new_pin(p.PIN_26, Pull::None),
                gas: adc::Channel::new_pin(p.PIN_27, Pull::None),
                length: adc::Channel::new_pin(p.PIN_28, Pull::None),
            },
            run_line: Input::new(p.PIN_14, Pull::Down),
            valves,
            flash: Some(StoreFlash::new(p.FLASH)),
            led: Output::new(p.PIN_25, Level::Low),
            fault_output: Output::new(p.PIN_15, Level::Low),
            #[cfg(feature = "joint")]
            brake_release: Some(Output::new(p.PIN_20, Level::Low)),
            #[cfg(not(feature = "joint"))]
            brake_release: None,
            receiver,
            sender,
            usb: (usb, unique_id),
            gas_buses,
            i2c,
        }
    }

    fn start_control(executor: &'static InterruptExecutor) -> SendSpawner {
        interrupt::SWI_IRQ_1.set_priority(Priority::P1);
        executor.start(interrupt::SWI_IRQ_1)
    }

    fn feed() {
        // SAFETY: feeding writes a single register.
        Watchdog::new(unsafe { peripherals::WATCHDOG::steal() }).feed(WATCHDOG);
    }

    fn vent() {
        // SAFETY: nothing else runs any more.
        let (inlet, outlet) = unsafe { (PIN_16::steal(), PIN_17::steal()) };
        // Forgotten, because a dropped output releases its pin.
        core::mem::forget((Output::new(inlet, Level::Low), Output::new(outlet, Level::Low)));
        #[cfg(feature = "joint")]
        {
            // SAFETY: as above.
            let pins = unsafe { (PIN_18::steal(), PIN_19::steal(), PIN_20::steal()) };
            let (inlet, outlet, brake) = pins;
            core::mem::forget((Output::new(inlet, Level::Low), Output::new(outlet, Level::Low)));
            core::mem::forget(Output::new(brake, Level::Low));
        }
    }

    fn usb_reset_waits() -> bool {
        pac::USB.sie_status().read().bus_reset()
    }

    fn restart() -> ! {
        // SAFETY: nothing else runs any more.
        let mut watchdog = Watchdog::new(unsafe { peripherals::WATCHDOG::steal() });
        watchdog.trigger_reset();
        loop {
            cortex_m::asm::nop();
        }
    }

    const BOOT_LOADER: Option<fn() -> !> = Some(|| {
        cortex_m::interrupt::disable();
        Self::vent();
        // The boot loader does not feed the watchdog.
        pac::WATCHDOG.ctrl().modify(|ctrl| ctrl.set_enable(false));
        M::boot_loader()
    });
}

/// Sets up the serial line. Must be called only once.
fn serial(
    uart: Peri<'static, peripherals::UART0>,
    tx: Peri<'static, peripherals::PIN_0>,
    rx: Peri<'static, peripherals::PIN_1>,
) -> (BufferedUartTx, BufferedUartRx) {
    static TX: StaticCell<[u8; 512]> = StaticCell::new();
    static RX: StaticCell<[u8; 512]> = StaticCell::new();
    let mut config = UartConfig::default();
    config.baudrate = BAUD;
    let [tx_buffer, rx_buffer] = [&TX, &RX].map(|buffer| buffer.init_with(|| [0; 512]));
    let uart = BufferedUart::new(uart, tx, rx, Irqs, tx_buffer, rx_buffer, config);
    // The interrupt comes at half of the receiver's 32 bytes, which leaves room for 170 us.
    pac::UART0.uartifls().modify(|levels| levels.set_rxiflsel(0b010));
    // Above control, whose step takes longer than that.
    interrupt::UART0_IRQ.set_priority(Priority::P0);
    uart.split()
}

/// Words of the vector table: 16 of the Arm core, and one for each interrupt of the chip.
const VECTORS: usize = 16 + if cfg!(feature = "pico2") { 52 } else { 32 };

/// Vector table in RAM, like the rest of the program: flash cannot be read while it is written.
/// Aligned for the longer of both tables (Armv8-M, VTOR).
#[repr(C, align(512))]
struct VectorTable([u32; VECTORS]);

/// Moves the vector table to RAM. Must be called only once.
fn vectors_to_ram() {
    static TABLE: StaticCell<VectorTable> = StaticCell::new();
    // SAFETY: the active table has this length, and both have the same handlers.
    unsafe {
        let scb = &*cortex_m::peripheral::SCB::PTR;
        let table = TABLE.init_with(|| VectorTable(*(scb.vtor.read() as *const _)));
        scb.vtor.write(table.0.as_ptr() as u32);
    }
}

pub struct Converter {
    adc: adc::Adc<'static, Blocking>,
    pressure: adc::Channel<'static>,
    gas: adc::Channel<'static>,
    length: adc::Channel<'static>,
}

impl Adc for Converter {
    fn convert(&mut self, channel: Channel) -> u16 {
        let channel = match channel {
            Channel::Adc0 => &mut self.pressure,
            Channel::Adc1 => &mut self.gas,
            Channel::Adc2 => &mut self.length,
        };
        // A failed conversion reads as a broken sensor, which the core's supervisor detects.
        self.adc.blocking_read(channel).unwrap_or(0)
    }

    /// Masks the UART, whose receiver buffers meanwhile, and the timer, which wakes only tasks
    /// below control: they must wait for control anyway.
    fn hold_others(&mut self, held: bool) {
        if held {
            interrupt::UART0_IRQ.disable();
            TIMER_IRQ.disable();
        } else {
            // SAFETY: both were enabled before.
            unsafe {
                interrupt::UART0_IRQ.enable();
                TIMER_IRQ.enable();
            }
        }
    }
}

/// Counts of the PWM per period: the divider is then exact for every whole number of milliseconds,
/// at the 150 MHz of the RP2350 and at the 200 MHz of the RP2040.
const TICKS: u16 = if cfg!(feature = "pico2") { 60_000 } else { 64_000 };

/// Pins of inlet and outlet of each muscle. Muscle a is on PWM slice 0, muscle b on slice 1.
const COIL_PINS: [[usize; 2]; 2] = [[16, 17], [18, 19]];

/// The PWM slices of all valves. Their counters run together from 0 to [`TICKS`] - 1, or over the
/// clocks of a carrier period: the full duty is above the counter's top, always on.
pub struct Slices([Slice; MUSCLES]);

/// One muscle's valves.
struct Slice {
    pwm: Pwm<'static>,
    config: PwmConfig,
    over: Outover,
    pins: [usize; 2],
}

/// Divider of the system clock, in sixteenths, for a period of `steps`.
fn divider_sixteenths(steps: u16) -> u32 {
    let clocks = clk_sys_freq() / 1_000_000 * STEP_US * u32::from(steps);
    16 * clocks / u32::from(TICKS)
}

impl Slices {
    fn new(pwm: [Pwm<'static>; MUSCLES]) -> Self {
        let mut pins = COIL_PINS.into_iter();
        Self(pwm.map(|pwm| Slice {
            pwm,
            config: Slice::off(),
            over: Outover::NORMAL,
            pins: pins.next().unwrap_or_default(),
        }))
    }
}

impl Slice {
    fn off() -> PwmConfig {
        let mut config = PwmConfig::default();
        config.top = TICKS - 1;
        config.enable = false;
        config
    }

    fn set_coils(&mut self, command: Command) {
        let (inlet, outlet) = command.coils();
        let ticks = self.config.top + 1;
        self.config.compare_a = inlet.ticks(ticks);
        self.config.compare_b = outlet.ticks(ticks);
    }

    /// Stops the PWM shortly before the start of a period of another modulation.
    fn stop_before(&mut self, modulation: Modulation) {
        self.config.enable = false;
        self.pwm.set_config(&self.config);
        let (ticks, sixteenths, delay) = match modulation {
            Modulation::Pulses { period_steps } => {
                let period_us = u32::from(period_steps.max(1)) * STEP_US;
                let ticks = u32::from(TICKS);
                let delay = ticks * PWM_DELAY.as_micros() as u32 / period_us;
                (ticks, divider_sixteenths(period_steps), delay)
            }
            Modulation::Carrier => (clk_sys_freq() / CARRIER_HZ, 16, 1),
        };
        self.config.top = (ticks - 1) as u16;
        self.config.divider = fixed::FixedU16::from_bits(sixteenths as u16);
        self.pwm.set_config(&self.config);
        self.pwm.set_counter((ticks - delay.max(1)) as u16);
        self.config.enable = true;
    }

    fn drive(&mut self, command: Command) {
        let before = (self.config.compare_a, self.config.compare_b);
        self.set_coils(command);
        // The pad's override acts at once and keeps the PWM's phase.
        let over = if command == Command::VENT { Outover::LOW } else { Outover::NORMAL };
        if over != self.over {
            for pin in self.pins {
                pac::IO_BANK0.gpio(pin).ctrl().modify(|ctrl| ctrl.set_outover(over));
            }
            self.over = over;
        }
        if (self.config.compare_a, self.config.compare_b) != before {
            // Compare values take effect where the counter wraps, so that no pulse is cut.
            self.pwm.set_config(&self.config);
        }
    }
}

impl Valves for Slices {
    fn restart(&mut self, modulation: Modulation, commands: Commands) {
        let slices = &mut self.0;
        slices.iter_mut().for_each(|slice| slice.stop_before(modulation));
        // In one write, so that they share their phase.
        pac::PWM.en().write(|enabled| {
            (0..MUSCLES).for_each(|slice| enabled.0 |= 1 << slice);
        });
        self.drive(commands);
    }

    fn drive(&mut self, commands: Commands) {
        for (slice, command) in self.0.iter_mut().zip(each(commands)) {
            slice.drive(command);
        }
    }
}
