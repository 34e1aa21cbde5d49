//! Honeywell MPR, pressure (data sheet 32332628): I2C at 0x18, at most 400 kHz. A measurement takes
//! 5 ms.

use crate::Error;
use embedded_hal_async::i2c::I2c;

/// Address of most sensors of the series.
const ADDRESS: u8 = 0x18;
/// Command that starts a measurement.
const MEASURE: [u8; 3] = [0xaa, 0, 0];
/// Bits of the status. The bits for damaged memory and saturated arithmetic are 0 in a healthy
/// sensor.
const POWERED: u8 = 0x40;
const BUSY: u8 = 0x20;

pub struct Mpr<I>(I);

impl<I: I2c> Mpr<I> {
    pub fn new(i2c: I) -> Self {
        Self(i2c)
    }

    /// Starts a measurement: its reading is ready 5 ms later.
    pub async fn start(&mut self) -> Result<(), Error<I::Error>> {
        Ok(self.0.write(ADDRESS, &MEASURE).await?)
    }

    /// Reads the measurement, in parts of 2^24; `None` while busy. Every status other than powered
    /// and busy is [`Error::Broken`].
    pub async fn read(&mut self) -> Result<Option<u32>, Error<I::Error>> {
        let mut bytes = [0; 4];
        self.0.read(ADDRESS, &mut bytes).await?;
        let [status, high, middle, low] = bytes;
        match status {
            POWERED => Ok(Some(u32::from_be_bytes([0, high, middle, low]))),
            _ if status == POWERED | BUSY => Ok(None),
            _ => Err(Error::Broken),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::now;
    use embedded_hal_async::i2c::{ErrorKind, ErrorType, NoAcknowledgeSource, Operation};
    use std::vec::Vec;

    #[derive(Default)]
    struct Part {
        answer: Option<[u8; 4]>,
        written: Vec<Vec<u8>>,
    }

    impl ErrorType for Part {
        type Error = ErrorKind;
    }

    impl I2c for Part {
        async fn transaction(
            &mut self,
            address: u8,
            operations: &mut [Operation<'_>],
        ) -> Result<(), ErrorKind> {
            assert_eq!(address, 0x18);
            let Some(answer) = self.answer else {
                return Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address));
            };
            for operation in operations {
                match operation {
                    Operation::Write(bytes) => self.written.push(bytes.to_vec()),
                    Operation::Read(bytes) => bytes.copy_from_slice(&answer),
                }
            }
            Ok(())
        }
    }

    #[test]
    fn a_measurement_is_started_and_read() {
        let mut part = Mpr::new(Part { answer: Some([0x40, 0x66, 0x66, 0x67]), ..Part::default() });
        now(part.start()).unwrap();
        assert_eq!(part.0.written, [[0xaa, 0, 0]]);
        assert_eq!(now(part.read()), Ok(Some(0x66_6667)));
    }

    #[test]
    fn a_busy_broken_or_missing_sensor_gives_no_reading() {
        let mut part = Mpr::new(Part { answer: Some([0x60, 0, 0, 0]), ..Part::default() });
        assert_eq!(now(part.read()), Ok(None));
        // Memory, arithmetic, no power, a bus stuck high.
        for status in [0x44, 0x41, 0x00, 0xff] {
            part.0.answer = Some([status, 0x66, 0x66, 0x67]);
            assert_eq!(now(part.read()), Err(Error::Broken));
        }
        part.0.answer = None;
        let no_answer = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address);
        assert_eq!(now(part.read()), Err(Error::Bus(no_answer)));
        assert_eq!(now(part.start()), Err(Error::Bus(no_answer)));
    }
}
