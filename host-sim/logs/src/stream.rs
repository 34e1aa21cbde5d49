//! `--stream udp:HOST:PORT`: a JSON datagram per recorded row, in the form that PlotJuggler's UDP server accepts.
//!
//! Receivers may be late, slow or gone: a datagram that cannot be sent at once is lost, and the
//! record never waits.

use super::topics::{Layout, write_json};
use std::fmt;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::str::FromStr;
use thermyo_record::sinks::Sink;

/// Second name of a row's time in addition to `time_s`: every PlotJuggler accepts it.
const TIMESTAMP: &str = "timestamp";

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StreamTo {
    address: SocketAddr,
    written: String,
}

/// A text that is not an address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// Host or port is missing.
    #[error("must be udp:HOST:PORT, such as udp:127.0.0.1:9870")]
    Form,
    #[error("no host is called so: {0}")]
    Host(String),
}

impl FromStr for StreamTo {
    type Err = StreamError;

    fn from_str(text: &str) -> Result<Self, StreamError> {
        let place = text.strip_prefix("udp:").ok_or(StreamError::Form)?;
        let (host, port) = place.rsplit_once(':').ok_or(StreamError::Form)?;
        match port.parse::<u16>() {
            Ok(1..) if !host.is_empty() => (),
            _ => return Err(StreamError::Form),
        }
        let found = place.to_socket_addrs().map(|mut found| found.next());
        match found {
            Ok(Some(address)) => Ok(Self { address, written: text.to_owned() }),
            Ok(None) => Err(StreamError::Host(host.to_owned())),
            Err(error) => Err(StreamError::Host(format!("{host}: {error}"))),
        }
    }
}

impl fmt::Display for StreamTo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.written)
    }
}

#[derive(Debug)]
pub struct Stream {
    socket: UdpSocket,
    columns: Vec<&'static str>,
    text: String,
}

impl Stream {
    /// Opens the socket. A receiver need not exist yet.
    pub fn open(to: &StreamTo, layout: Layout) -> io::Result<Self> {
        let any: SocketAddr = match to.address {
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let socket = UdpSocket::bind(any)?;
        socket.connect(to.address)?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, columns: (layout.columns)(), text: String::with_capacity(2048) })
    }
}

impl Sink for Stream {
    fn row(&mut self, cells: &[f64]) -> io::Result<()> {
        self.text.clear();
        let time = [(TIMESTAMP, cells.first().copied())].into_iter();
        let known = self.columns.iter().zip(cells).map(|(name, cell)| (*name, Some(*cell)));
        write_json(&mut self.text, time.chain(known));
        // The datagram is lost if there is no receiver or the network is busy.
        let _ = self.socket.send(self.text.as_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topics::MUSCLE;
    use std::time::{Duration, Instant};

    #[test]
    fn an_address_is_udp_host_and_port() {
        assert!("udp:127.0.0.1:9870".parse::<StreamTo>().is_ok());
        assert!("udp:[::1]:9870".parse::<StreamTo>().is_ok());
        for text in [
            "",
            "127.0.0.1:9870",
            "tcp:127.0.0.1:9870",
            "udp:127.0.0.1",
            "udp::1",
            "udp:a:0",
            "udp:a:x",
        ] {
            assert_eq!(text.parse::<StreamTo>(), Err(StreamError::Form), "{text}");
        }
        let nobody = "udp:nobody.invalid:9870".parse::<StreamTo>();
        assert!(matches!(nobody, Err(StreamError::Host(_))), "{nobody:?}");
    }

    #[test]
    fn a_row_is_a_datagram() {
        let listener = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        listener.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let to = format!("udp:{}", listener.local_addr().unwrap()).parse().unwrap();
        let mut stream = Stream::open(&to, MUSCLE).unwrap();
        stream.row(&[0.5, 1.0e5, f64::NAN, 0.2]).unwrap();
        let mut bytes = [0; 4096];
        let length = listener.recv(&mut bytes).unwrap();
        let text = std::str::from_utf8(&bytes[..length]).unwrap();
        assert_eq!(text, r#"{"timestamp":0.5,"time_s":0.5,"pressure_pa":100000,"length_m":0.2}"#);
    }

    /// Rows continue without delay if the receiver does not read, or is gone.
    #[test]
    fn a_listener_that_is_slow_or_gone_delays_nothing() {
        let listener = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let to = format!("udp:{}", listener.local_addr().unwrap()).parse().unwrap();
        let mut stream = Stream::open(&to, MUSCLE).unwrap();
        let row = vec![1.0 / 3.0; (MUSCLE.columns)().len()];
        let begin = Instant::now();
        (0..20_000).for_each(|_| stream.row(&row).unwrap());
        drop(listener);
        (0..20_000).for_each(|_| stream.row(&row).unwrap());
        assert!(begin.elapsed() < Duration::from_secs(60), "a row waited");
    }
}
