//! Serial ports of USB.

use serialport::{SerialPortType, UsbPortInfo};
use thermyo_protocol::USB_ID;

/// Names of the ports that are a board's own USB, whatever firmware it runs.
pub fn boards() -> Vec<String> {
    usb()
        .into_iter()
        .filter(|(_, info)| (info.vid, info.pid) == USB_ID)
        .map(|(port, _)| port)
        .collect()
}

pub(crate) fn usb() -> Vec<(String, UsbPortInfo)> {
    let ports = serialport::available_ports().unwrap_or_default();
    let mut usb: Vec<_> = ports
        .into_iter()
        .filter_map(|port| match port.port_type {
            SerialPortType::UsbPort(info) => Some((port.port_name, info)),
            _ => None,
        })
        .collect();
    usb.sort_by(|(a, _), (b, _)| a.cmp(b));
    usb
}
