//! Maxim MAX31865, RTD to digital (data sheet 19-6478): SPI mode 1 or 3, at most 5 MHz. It converts
//! by itself every 20 ms, and its DRDY is low while there is an unread reading.

use crate::Error;
use embedded_hal_async::spi::SpiDevice;

/// Address of the configuration, and the bit of an address that writes.
const CONFIG: u8 = 0x00;
const WRITE: u8 = 0x80;
/// Bits of the configuration: bias, continuous conversion, clear faults, 50 Hz filter. 2 or 4
/// wires.
const BIAS: u8 = 0x80;
const CONTINUOUS: u8 = 0x40;
const CLEAR: u8 = 0x02;
const FILTER_50_HZ: u8 = 0x01;
/// Configuration as it reads back once started.
const RUNNING: u8 = BIAS | CONTINUOUS | FILTER_50_HZ;

pub struct Max31865<S>(S);

impl<S: SpiDevice> Max31865<S> {
    pub fn new(spi: S) -> Self {
        Self(spi)
    }

    /// Starts conversions. The first reading takes 63 ms.
    pub async fn start(&mut self) -> Result<(), Error<S::Error>> {
        // The filter must not change during conversions.
        self.configure(BIAS | CLEAR | FILTER_50_HZ).await?;
        self.configure(RUNNING).await
    }

    async fn configure(&mut self, config: u8) -> Result<(), Error<S::Error>> {
        Ok(self.0.write(&[CONFIG | WRITE, config]).await?)
    }

    /// Reads the last reading, R/R_ref in parts of 32768, and the configuration, which shows a loss
    /// of power. A fault is returned as [`Error::Broken`] and cleared in the chip.
    pub async fn read(&mut self) -> Result<u16, Error<S::Error>> {
        let mut bytes = [CONFIG; 4];
        self.0.transfer_in_place(&mut bytes).await?;
        let [_, config, high, low] = bytes;
        if config != RUNNING {
            return Err(Error::NotThere);
        }
        if low & 1 != 0 {
            self.configure(RUNNING | CLEAR).await?;
            return Err(Error::Broken);
        }
        Ok(u16::from_be_bytes([high, low]) >> 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::now;
    use embedded_hal_async::spi::{ErrorKind, ErrorType, Operation};
    use std::vec::Vec;

    /// The chip's registers behind a bus, as in the data sheet.
    #[derive(Default)]
    struct Chip {
        registers: [u8; 8],
        written: Vec<u8>,
        fails: bool,
    }

    impl ErrorType for Chip {
        type Error = ErrorKind;
    }

    impl SpiDevice for Chip {
        async fn transaction(
            &mut self,
            operations: &mut [Operation<'_, u8>],
        ) -> Result<(), ErrorKind> {
            if self.fails {
                return Err(ErrorKind::Other);
            }
            for operation in operations {
                match operation {
                    Operation::Write([0x80, config]) => {
                        self.written.push(*config);
                        // The bit clears the faults and itself.
                        self.registers[0] = config & !CLEAR;
                        if config & CLEAR != 0 {
                            self.registers[7] = 0;
                            self.registers[2] &= !1;
                        }
                    }
                    Operation::TransferInPlace(bytes) => {
                        assert_eq!(bytes[0], 0);
                        bytes[1..].copy_from_slice(&self.registers[..3]);
                    }
                    other => panic!("{other:?}"),
                }
            }
            Ok(())
        }
    }

    fn running(registers: [u8; 8]) -> Max31865<Chip> {
        let mut chip = Max31865::new(Chip { registers, ..Chip::default() });
        now(chip.start()).unwrap();
        chip
    }

    #[test]
    fn start_sets_the_filter_before_conversions() {
        let chip = running([0; 8]);
        assert_eq!(chip.0.written, [0x83, 0xc1]);
    }

    #[test]
    fn a_reading_is_fifteen_bits() {
        let mut chip = running([0, 0x40, 0x12, 0xff, 0xff, 0, 0, 0]);
        assert_eq!(now(chip.read()), Ok(0x2009));
    }

    #[test]
    fn a_fault_is_reported_and_cleared() {
        // Open: the reading is above the high threshold.
        let mut chip = running([0, 0xff, 0xff, 0xff, 0xff, 0, 0, 0]);
        chip.0.registers[2] = 0xff;
        chip.0.registers[7] = 0x80;
        assert_eq!(now(chip.read()), Err(Error::Broken));
        assert_eq!(chip.0.written.last(), Some(&0xc3));
        assert_eq!(now(chip.read()), Ok(0x7fff), "until the chip reports it again");
    }

    #[test]
    fn a_bus_without_the_chip_gives_no_reading() {
        let mut chip = running([0; 8]);
        for level in [0x00, 0xff] {
            chip.0.registers = [level; 8];
            assert_eq!(now(chip.read()), Err(Error::NotThere));
        }
        // After a loss of power the registers have their initial values.
        chip.0.registers = [0, 0x40, 0, 0xff, 0xff, 0, 0, 0];
        assert_eq!(now(chip.read()), Err(Error::NotThere));
        chip.0.fails = true;
        assert_eq!(now(chip.read()), Err(Error::Bus(ErrorKind::Other)));
    }
}
