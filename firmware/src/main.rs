//! Firmware of the valve controller.
//!
//! Two executors run the tasks. The upper one, in an interrupt, runs the control task alone: at
//! every whole millisecond it samples, steps the core and drives the valves. The lower one, in the
//! thread, runs the links to the host, the keeper of the nonvolatile store, and the supervisor,
//! which feeds the watchdog. Only the folder `board` depends on a chip; all else uses the traits in
//! [`board`].

#![no_std]
#![no_main]
#![deny(clippy::indexing_slicing, clippy::unwrap_used)]

mod black_box;
mod board;
mod control;
mod keeper;
mod kind;
mod link;
#[cfg_attr(feature = "hil", allow(dead_code))]
mod parts;
mod shared;
mod source;
mod store;
mod supervisor;
#[cfg(feature = "usb")]
mod usb;

use black_box::{BlackBox, End, Remembered};
use board::{Board, Chosen, Parts};
use control::Control;
use core::panic::PanicInfo;
use cortex_m_rt::ExceptionFrame;
use defmt_rtt as _;
use embassy_executor::{Executor, InterruptExecutor, Spawner};
use embassy_time::Instant;
use kind::{Config, Core, checksum};
use shared::{Line, Shared};
use static_cell::StaticCell;
use thermyo_protocol::LastReset;

#[cfg(all(feature = "joint", feature = "hil"))]
compile_error!("`joint` is without `hil`");

type Valves = <Chosen as Board>::Valves;
type Flash = <Chosen as Board>::Flash;
type Output = <Chosen as Board>::Output;
type Receiver = <Chosen as Board>::Receiver;
type Sender = <Chosen as Board>::Sender;
#[cfg(feature = "usb")]
type Usb = <Chosen as Board>::Usb;
#[cfg(not(feature = "hil"))]
type Source = source::Inputs<<Chosen as Board>::Adc, <Chosen as Board>::Input>;
#[cfg(feature = "hil")]
type Source = source::Host;

defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

static SHARED: Shared = Shared::new();
static CONTROL: InterruptExecutor = InterruptExecutor::new();
#[unsafe(link_section = ".black_box")]
static BLACK_BOX: BlackBox = BlackBox::new();

#[cortex_m_rt::entry]
fn main() -> ! {
    let parts: Parts<Chosen> = Board::start();
    let (last_reset, remembered) = BLACK_BOX.open(parts.reset);
    SHARED.change_status(|status| {
        status.restarts = BLACK_BOX.restarts();
        status.config_checksum = checksum(&Config::default());
    });
    let [major, minor, patch] = link::FIRMWARE;
    defmt::info!("thermyo firmware {}.{}.{}", major, minor, patch);

    #[cfg(not(feature = "hil"))]
    let source = source::Inputs::new(parts.adc, parts.run_line, &SHARED);
    #[cfg(feature = "hil")]
    let source = source::Host::new(&SHARED);
    let identity = link::Identity {
        chip: Chosen::CHIP,
        last_reset,
        maximum_period_steps: Chosen::maximum_period_steps(),
        boot_loader: Chosen::BOOT_LOADER,
    };

    #[cfg(feature = "usb")]
    let [serial, usb_line] = &SHARED.lines;
    #[cfg(not(feature = "usb"))]
    let [serial] = &SHARED.lines;
    let core = core(remembered);
    static NEXT: StaticCell<Core> = StaticCell::new();
    SHARED.stage(NEXT.init_with(kind::unconfigured));
    let control = Chosen::start_control(&CONTROL);
    static THREAD: StaticCell<Executor> = StaticCell::new();
    THREAD.init_with(Executor::new).run(|thread| {
        let (Ok(send), Ok(receive), Ok(keep), Ok(supervise), Ok(step)) = (
            send(parts.sender, serial),
            receive(parts.receiver, serial, identity),
            keep(parts.flash, identity),
            supervise([parts.led, parts.fault_output], last_reset),
            step(source, (parts.valves, parts.brake_release), core),
        ) else {
            panic!("each task is started once");
        };
        thread.spawn(send);
        thread.spawn(receive);
        thread.spawn(keep);
        thread.spawn(supervise);
        control.spawn(step);
        start_parts(thread, parts.gas_buses, parts.i2c);
        #[cfg(feature = "usb")]
        start_usb(thread, parts.usb, usb_line, identity);
    })
}

/// Creates the core, with the first failure from before a restart.
fn core(remembered: Remembered) -> &'static mut Core {
    // Static: a task that owned the core would hold three copies, in `main`, argument and variable.
    static CORE: StaticCell<Core> = StaticCell::new();
    let core = CORE.init_with(kind::unconfigured);
    if let Some((first, latched)) = remembered {
        core.recall(first, latched);
    }
    core
}

fn start_parts(
    thread: Spawner,
    gas_buses: [(<Chosen as Board>::GasBus, <Chosen as Board>::Input); kind::MUSCLES],
    i2c: <Chosen as Board>::I2c,
) {
    let Ok(on_i2c) = read_i2c(i2c) else {
        panic!("each task is started once");
    };
    thread.spawn(on_i2c);
    for ((bus, ready), part) in gas_buses.into_iter().zip(&SHARED.parts.gas) {
        let Ok(gas) = read_gas(bus, ready, part) else {
            panic!("there is one task for each sensor");
        };
        thread.spawn(gas);
    }
}

#[cfg(feature = "usb")]
fn start_usb(thread: Spawner, usb: (Usb, [u8; 8]), line: &'static Line, identity: link::Identity) {
    let (device, sender, receiver) = usb::open(usb, line);
    let (Ok(run), Ok(send), Ok(receive)) =
        (run_usb(device), send_usb(sender, line), receive_usb(receiver, line, identity))
    else {
        panic!("each task is started once");
    };
    thread.spawn(run);
    thread.spawn(send);
    thread.spawn(receive);
}

/// Runs the control task.
///
/// # Safety
/// Only in the interrupt in which [`Board::start_control`] started its executor.
pub unsafe fn on_control_interrupt() {
    // SAFETY: as above.
    unsafe { CONTROL.on_interrupt() }
}

#[embassy_executor::task]
async fn step(source: Source, outputs: (Valves, Option<Output>), core: &'static mut Core) -> ! {
    Control::new(core, source, outputs, Chosen::feed, &BLACK_BOX, &SHARED).run().await
}

#[embassy_executor::task]
async fn send(sender: Sender, line: &'static Line) -> ! {
    link::send(sender, line).await
}

#[embassy_executor::task]
async fn receive(receiver: Receiver, line: &'static Line, identity: link::Identity) -> ! {
    link::receive(receiver, line, identity, &SHARED).await
}

#[cfg(feature = "usb")]
#[embassy_executor::task]
async fn run_usb(device: usb::Device<Usb>) -> ! {
    usb::run(device, Chosen::usb_reset_waits).await
}

#[cfg(feature = "usb")]
#[embassy_executor::task]
async fn send_usb(sender: usb::Sender<Usb>, line: &'static Line) -> ! {
    link::send(sender, line).await
}

#[cfg(feature = "usb")]
#[embassy_executor::task]
async fn receive_usb(
    receiver: usb::Receiver<Usb>,
    line: &'static Line,
    identity: link::Identity,
) -> ! {
    link::receive(receiver, line, identity, &SHARED).await
}

#[embassy_executor::task(pool_size = kind::MUSCLES)]
async fn read_gas(
    bus: <Chosen as Board>::GasBus,
    ready: <Chosen as Board>::Input,
    part: &'static parts::Part,
) -> ! {
    parts::read_gas(bus, ready, part).await
}

#[embassy_executor::task]
async fn read_i2c(bus: <Chosen as Board>::I2c) -> ! {
    parts::read_i2c(bus, &SHARED.parts.on_i2c).await
}

#[embassy_executor::task]
async fn keep(flash: Option<Flash>, identity: link::Identity) -> ! {
    keeper::run(flash, identity, &SHARED).await
}

#[embassy_executor::task]
async fn supervise(outputs: [Output; 2], last_reset: LastReset) -> ! {
    supervisor::run(Chosen::feed, outputs, last_reset, &SHARED).await
}

/// Vents, records the cause in the black box, logs it if it is the first, and restarts.
fn give_up(end: End, detail: u32, log: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    Chosen::vent();
    if BLACK_BOX.close(end, detail) {
        log();
    }
    Chosen::restart()
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    let (file, line) = info.location().map_or(("?", 0), |place| (place.file(), place.line()));
    give_up(End::Panic, line, || defmt::error!("panic at {=str}:{=u32}", file, line))
}

#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    give_up(End::HardFault, frame.pc(), || ())
}
