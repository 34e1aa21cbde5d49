//! The chip's own USB as a serial port (CDC-ACM).

use crate::shared::Line;
use core::future::poll_fn;
use core::str;
use core::task::Poll;
use embassy_futures::select::select;
use embassy_usb::class::cdc_acm::{BufferedReceiver, CdcAcmClass, Sender as PacketSender, State};
use embassy_usb::control::{OutResponse, Request, RequestType};
use embassy_usb::driver::{Driver, EndpointError};
use embassy_usb::{Builder, Config, Handler, UsbDevice};
use embedded_io_async::{ErrorKind, ErrorType, Write};
use static_cell::{ConstStaticCell, StaticCell};
use thermyo_protocol::{USB_ID, USB_MANUFACTURER};

/// Longest packet of a bulk endpoint at full speed.
const PACKET: u16 = 64;
/// Longest packet that is sent. After a full packet the host would wait for another, possibly empty
/// one before it delivers the data (USB 2.0, 5.8.3).
const SHORT_PACKET: usize = PACKET as usize - 1;
/// Request whose bit 0 of the value is set while the port is open (CDC PSTN 1.2, 6.3.12).
const SET_CONTROL_LINE_STATE: u8 = 0x22;

pub type Device<D> = UsbDevice<'static, D>;
pub type Receiver<D> = BufferedReceiver<'static, D>;

/// Opens the port. Returns the device with this serial number, which [`run`] must run, and the
/// port's two halves.
pub fn open<D: Driver<'static>>(
    (driver, unique_id): (D, [u8; 8]),
    line: &'static Line,
) -> (Device<D>, Sender<D>, Receiver<D>) {
    static CONFIGURATION: ConstStaticCell<[u8; 96]> = ConstStaticCell::new([0; 96]);
    static CAPABILITIES: ConstStaticCell<[u8; 16]> = ConstStaticCell::new([0; 16]);
    static CONTROL: ConstStaticCell<[u8; 64]> = ConstStaticCell::new([0; 64]);
    static RECEIVED: ConstStaticCell<[u8; PACKET as usize]> =
        ConstStaticCell::new([0; PACKET as usize]);
    static STATE: StaticCell<State<'static>> = StaticCell::new();
    static WATCH: StaticCell<Watch> = StaticCell::new();

    let mut config = Config::new(USB_ID.0, USB_ID.1);
    config.manufacturer = Some(USB_MANUFACTURER);
    config.product = Some("Thermyo valve controller");
    config.serial_number = Some(hexadecimal(unique_id));
    let mut builder = Builder::new(
        driver,
        config,
        CONFIGURATION.take(),
        CAPABILITIES.take(),
        &mut [],
        CONTROL.take(),
    );
    builder.handler(WATCH.init(Watch(line)));
    let class = CdcAcmClass::new(&mut builder, STATE.init(State::new()), PACKET);
    let (sender, receiver) = class.split();
    (builder.build(), Sender(sender), receiver.into_buffered(RECEIVED.take()))
}

/// Runs a device; `reset_waits` returns whether a bus reset waits to be handled.
///
/// embassy's device does not watch the bus while it answers a request of the host. If it is
/// unplugged meanwhile, it would wait for ever for the rest, at an address that the next host does
/// not use.
pub async fn run<D: Driver<'static>>(mut device: Device<D>, reset_waits: fn() -> bool) -> ! {
    loop {
        // The same interrupt wakes both; the device is polled first and clears the resets that it
        // handles.
        let unhandled = poll_fn(|_| if reset_waits() { Poll::Ready(()) } else { Poll::Pending });
        select(device.run(), unhandled).await;
        device.disable().await;
    }
}

fn hexadecimal(id: [u8; 8]) -> &'static str {
    static TEXT: StaticCell<[u8; 16]> = StaticCell::new();
    let number = u64::from_be_bytes(id);
    let digits = TEXT.init_with(|| {
        core::array::from_fn(|i| {
            let digit = (number >> (60 - 4 * i) & 0xf) as u8;
            if digit < 10 { b'0' + digit } else { b'A' + digit - 10 }
        })
    });
    str::from_utf8(digits).unwrap_or_default()
}

/// Closes the line when the cable is unplugged, the host asleep, or the port not open.
struct Watch(&'static Line);

impl Handler for Watch {
    fn reset(&mut self) {
        self.0.close();
    }

    fn suspended(&mut self, suspended: bool) {
        if suspended {
            self.0.close();
        }
    }

    /// Only observes the request: the class answers it.
    fn control_out(&mut self, request: Request, _data: &[u8]) -> Option<OutResponse> {
        let about_lines =
            request.request_type == RequestType::Class && request.request == SET_CONTROL_LINE_STATE;
        if about_lines && request.value & 1 == 0 {
            self.0.close();
        }
        None
    }
}

pub struct Sender<D: Driver<'static>>(PacketSender<'static, D>);

impl<D: Driver<'static>> ErrorType for Sender<D> {
    type Error = ErrorKind;
}

impl<D: Driver<'static>> Write for Sender<D> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        let packet = bytes.get(..SHORT_PACKET).unwrap_or(bytes);
        match self.0.write_packet(packet).await {
            Ok(()) => Ok(packet.len()),
            Err(EndpointError::Disabled) => Err(ErrorKind::NotConnected),
            Err(EndpointError::BufferOverflow) => Err(ErrorKind::InvalidInput),
        }
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}
