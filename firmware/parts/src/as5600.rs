//! ams AS5600, magnetic angle sensor of 12 bits a turn (data sheet DS000365): I2C at 0x36, at most
//! 1 MHz. It converts by itself every 150 us.

use crate::Error;
use embedded_hal_async::i2c::I2c;

const ADDRESS: u8 = 0x36;
/// Registers: high byte of the configuration, and status, which is followed by the angle before
/// scaling and hysteresis.
const CONF: u8 = 0x07;
const STATUS: u8 = 0x0b;
/// High byte of the angle, followed by its low byte.
const RAW_ANGLE: u8 = 0x0c;
/// Distance of the low byte from its end within which it may pass the end between two bytes: 2 LSB
/// of noise by the data sheet, and 100 rad/s for 0.1 ms are 7.
const NEAR: u8 = 32;
/// Bits of the status: magnet detected, too weak, too strong.
const DETECTED: u8 = 0x20;
const WEAK: u8 = 0x10;
const STRONG: u8 = 0x08;
/// Bits of the configuration's high byte: reserved bits, which keep their value, and the filter
/// that settles within 0.29 ms instead of 2.2 ms. The bits between are watchdog and fast filter:
/// off.
const RESERVED: u8 = 0xc0;
const FASTEST: u8 = 0x03;
/// Bits of its low byte that concern the chip's own output. The others are hysteresis and power
/// mode: off.
const OUTPUT: u8 = 0xf0;

pub struct As5600<I>(I);

impl<I: I2c> As5600<I> {
    pub fn new(i2c: I) -> Self {
        Self(i2c)
    }

    /// Configures the chip, which loses its configuration without power.
    pub async fn start(&mut self) -> Result<(), Error<I::Error>> {
        let [high, low, _] = self.registers(CONF).await?;
        let conf = [CONF, high & RESERVED | FASTEST, low & OUTPUT];
        Ok(self.0.write(ADDRESS, &conf).await?)
    }

    /// Reads the angle, in parts of 4096 of a turn. A magnet that is missing, too weak or too
    /// strong is [`Error::Broken`]. If the low byte is near its end, the two bytes may belong to
    /// different angles, 22.5 deg off: the high byte is then read again, and if it has changed, the
    /// angle is the one between both. `None` if it has changed by more.
    pub async fn read(&mut self) -> Result<Option<u16>, Error<I::Error>> {
        let [status, high, low] = self.registers(STATUS).await?;
        if status & (DETECTED | WEAK | STRONG) != DETECTED {
            return Err(Error::Broken);
        }
        let high = high & 0x0f;
        let angle = u16::from_be_bytes([high, low]);
        if (NEAR..=u8::MAX - NEAR).contains(&low) {
            return Ok(Some(angle));
        }
        let [again] = self.registers(RAW_ANGLE).await?;
        let again = again & 0x0f;
        let up = |high: u8| (high + 1) & 0x0f;
        Ok(if again == high {
            Some(angle)
        } else if again == up(high) {
            Some(u16::from_be_bytes([again, 0]))
        } else if high == up(again) {
            Some(u16::from_be_bytes([high, 0]))
        } else {
            None
        })
    }

    /// Reads registers from `first` on. Two messages, since the chip keeps its address pointer.
    async fn registers<const COUNT: usize>(
        &mut self,
        first: u8,
    ) -> Result<[u8; COUNT], Error<I::Error>> {
        let mut bytes = [0; COUNT];
        self.0.write(ADDRESS, &[first]).await?;
        self.0.read(ADDRESS, &mut bytes).await?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::now;
    use embedded_hal_async::i2c::{ErrorKind, ErrorType, NoAcknowledgeSource, Operation};

    const NO_ANSWER: ErrorKind = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address);

    /// The chip's registers behind a bus, as in the data sheet.
    struct Chip {
        registers: [u8; 0x20],
        pointer: usize,
        /// Messages that the chip still answers; then its wires are disconnected.
        answers: usize,
        /// High byte of the angle after the next reading of it.
        then: Option<u8>,
    }

    impl Default for Chip {
        fn default() -> Self {
            let mut registers = [0; 0x20];
            registers[usize::from(STATUS)] = DETECTED;
            Self { registers, pointer: 0, answers: usize::MAX, then: None }
        }
    }

    impl Chip {
        fn with(status: u8, high: u8, low: u8) -> As5600<Self> {
            let mut chip = Self::default();
            chip.registers[0x0b..0x0e].copy_from_slice(&[status, high, low]);
            As5600::new(chip)
        }
    }

    impl ErrorType for Chip {
        type Error = ErrorKind;
    }

    impl I2c for Chip {
        async fn transaction(
            &mut self,
            address: u8,
            operations: &mut [Operation<'_>],
        ) -> Result<(), ErrorKind> {
            assert_eq!(address, 0x36);
            if self.answers == 0 {
                return Err(NO_ANSWER);
            }
            self.answers -= 1;
            match operations {
                [Operation::Write([first, bytes @ ..])] => {
                    self.pointer = usize::from(*first);
                    self.registers[self.pointer..][..bytes.len()].copy_from_slice(bytes);
                }
                [Operation::Read(bytes)] => {
                    bytes.copy_from_slice(&self.registers[self.pointer..][..bytes.len()]);
                    if let Some(high) = self.then.take() {
                        self.registers[usize::from(RAW_ANGLE)] = high;
                    }
                }
                other => panic!("{other:?}: the board's bus takes one operation"),
            }
            Ok(())
        }
    }

    #[test]
    fn start_chooses_the_fastest_filter_and_keeps_what_it_does_not_own() {
        let mut chip = Chip::with(DETECTED, 0, 0);
        chip.0.registers[0x07..0x09].copy_from_slice(&[0xbc, 0xaf]);
        now(chip.start()).unwrap();
        assert_eq!(chip.0.registers[0x07..0x09], [0x83, 0xa0]);
        chip.0.answers = 2;
        assert_eq!(now(chip.start()), Err(Error::Bus(NO_ANSWER)));
    }

    #[test]
    fn an_angle_is_twelve_bits() {
        for (high, low, angle) in [(0x00, 0x00, 0), (0x08, 0x01, 0x801), (0xff, 0xff, 0xfff)] {
            assert_eq!(now(Chip::with(DETECTED, high, low).read()), Ok(Some(angle)));
        }
        // The reserved bits of the status may be anything.
        assert_eq!(now(Chip::with(0xe7, 1, 2).read()), Ok(Some(0x102)));
    }

    /// From 0x7ff to 0x800 between the two bytes it would be 0x700 or 0x8ff. If such readings were
    /// dropped, ten in a row would be a lost angle: an arm held there has noise across the end of
    /// the low byte in every other reading.
    #[test]
    fn bytes_of_two_angles_are_the_angle_between_them() {
        for (first, low, then, angle) in [
            (0x07, 0x00, 0x08, Some(0x800)),
            (0x08, 0xff, 0x07, Some(0x800)),
            (0x0f, 0x00, 0x00, Some(0)),
            (0x00, 0xff, 0x0f, Some(0)),
            (0x07, 0x02, 0x09, None),
        ] {
            let mut chip = Chip::with(DETECTED, first, low);
            chip.0.then = Some(then);
            assert_eq!(now(chip.read()), Ok(angle), "{first:#x} {low:#x} {then:#x}");
        }
        // A low byte far from its end belongs to one angle, whatever follows.
        let mut chip = Chip::with(DETECTED, 0x07, 0x80);
        chip.0.then = Some(0x08);
        assert_eq!(now(chip.read()), Ok(Some(0x780)));
    }

    #[test]
    fn a_magnet_that_is_missing_weak_or_strong_gives_no_angle() {
        // The last two are stuck buses.
        for status in [WEAK, STRONG, DETECTED | WEAK, DETECTED | STRONG, 0x00, 0xff] {
            assert_eq!(now(Chip::with(status, 1, 2).read()), Err(Error::Broken), "{status:#x}");
        }
    }

    #[test]
    fn a_chip_that_falls_silent_within_a_reading_gives_no_angle() {
        for answers in 0..4 {
            let mut chip = Chip::with(DETECTED, 1, 2);
            chip.0.answers = answers;
            assert_eq!(now(chip.read()), Err(Error::Bus(NO_ANSWER)), "{answers}");
        }
        let mut chip = Chip::with(DETECTED, 1, 2);
        chip.0.answers = 4;
        assert_eq!(now(chip.read()), Ok(Some(0x102)));
    }
}
