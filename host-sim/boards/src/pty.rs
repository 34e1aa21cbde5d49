//! The emulated board behind a pseudo-terminal, for programs that open a serial port. Unix only.

use super::emulated::{EmulatedBoard, Exchange};
use super::serial_port;
use model_core::Sample;
use serialport::{SerialPort, TTYPort};
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use thermyo_simulation::board::BoardError;

/// An emulated board that runs as fast as it can until this is dropped.
pub struct PtyBoard {
    port: String,
    stop: Arc<AtomicBool>,
    in_boot_loader: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl PtyBoard {
    /// Connects the UART of `board`, whose ADC gets `sample`, with a new pseudo-terminal.
    pub fn new(board: EmulatedBoard, sample: Sample) -> Result<Self, BoardError> {
        Self::with(board, move || move |board| board.exchange(&sample))
    }

    /// As [`Self::new`], with the plant that `make` creates at the board's pins; each call of it runs one millisecond.
    pub fn with<R>(
        mut board: EmulatedBoard,
        make: impl FnOnce() -> R + Send + 'static,
    ) -> Result<Self, BoardError>
    where
        R: FnMut(&mut EmulatedBoard) -> Result<Exchange, BoardError>,
    {
        let no_port = |error: serialport::Error| BoardError::NoPort {
            port: "pseudo-terminal".to_owned(),
            reason: error.to_string(),
        };
        let (mut master, slave) = TTYPort::pair().map_err(no_port)?;
        master.set_timeout(Duration::from_micros(1)).map_err(no_port)?;
        let port = slave.name().unwrap_or_default();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let in_boot_loader = Arc::new(AtomicBool::new(false));
        let left = Arc::clone(&in_boot_loader);
        let thread = thread::spawn(move || {
            // Kept open as long as the board lives: otherwise the master's reads fail.
            let _slave = slave;
            let (mut buffer, mut run) = ([0; 512], make());
            while !stopped.load(Ordering::Relaxed) {
                if let Ok(count) = serial_port::read(&mut master, &mut buffer) {
                    board.write(&buffer[..count]);
                }
                let Ok(exchange) = run(&mut board) else { break };
                left.store(exchange.boot_loader, Ordering::Relaxed);
                let _ = master.write_all(&board.read());
                board.take_telemetry();
                board.take_joint_telemetry();
            }
        });
        Ok(Self { port, stop, in_boot_loader, thread: Some(thread) })
    }

    pub fn in_boot_loader(&self) -> bool {
        self.in_boot_loader.load(Ordering::Relaxed)
    }

    pub fn port(&self) -> &str {
        &self.port
    }
}

impl Drop for PtyBoard {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
