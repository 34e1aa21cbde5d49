//! UF2, the format that a boot loader's drive takes (github.com/microsoft/uf2): blocks of 512
//! bytes, each of which holds the address in flash of its 256 bytes.

use elf::abi::PT_LOAD;
use elf::endian::LittleEndian;
use elf::{ElfBytes, ParseError};
use std::collections::BTreeMap;

const BLOCK: usize = 512;
const PAGE: usize = 256;
/// The boot ROM erases this much at a time. Pages of a sector that no block writes are left
/// undefined (RP2040 datasheet, erratum E14): every sector is filled.
const SECTOR: u32 = 4096;
const MAGIC_START: [u32; 2] = [0x0a32_4655, 0x9e5d_5157];
const MAGIC_END: u32 = 0x0ab1_6f30;
const FAMILY_IS_GIVEN: u32 = 0x2000;
const FLASH: std::ops::Range<u32> = 0x1000_0000..0x1100_0000;

/// Converts an image in ELF to a UF2 file, for the boot loader of a family of chips.
pub fn of_elf(image: &[u8], family: u32) -> Result<Vec<u8>, String> {
    let pages = pages(image)?;
    let count = pages.len() as u32;
    let block = |(number, (address, content)): (usize, (u32, [u8; PAGE]))| {
        let mut block = [0; BLOCK];
        let head = [
            MAGIC_START[0],
            MAGIC_START[1],
            FAMILY_IS_GIVEN,
            address,
            PAGE as u32,
            number as u32,
            count,
            family,
        ];
        for (place, word) in block.chunks_exact_mut(4).zip(head) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        block[32..32 + PAGE].copy_from_slice(&content);
        block[BLOCK - 4..].copy_from_slice(&MAGIC_END.to_le_bytes());
        block
    };
    Ok(pages.into_iter().enumerate().flat_map(block).collect())
}

/// Content of the flash by address.
fn pages(image: &[u8]) -> Result<BTreeMap<u32, [u8; PAGE]>, String> {
    let no_elf = |error: ParseError| format!("no ELF file: {error}");
    let file = ElfBytes::<LittleEndian>::minimal_parse(image).map_err(no_elf)?;
    let mut pages = BTreeMap::new();
    for segment in file.segments().into_iter().flatten() {
        let data = file
            .segment_data(&segment)
            .map_err(|_| "a segment lies outside of the file".to_owned())?;
        if segment.p_type != PT_LOAD || data.is_empty() {
            continue;
        }
        // The load address, not the address at which the segment runs.
        let start = u32::try_from(segment.p_paddr).unwrap_or(0);
        let end = start.checked_add(data.len() as u32).filter(|end| *end <= FLASH.end);
        let Some(end) = end.filter(|_| start >= FLASH.start) else {
            return Err(format!("a segment at {:#010x} does not lie in flash", segment.p_paddr));
        };
        for sector in (start / SECTOR..end.div_ceil(SECTOR)).map(|number| number * SECTOR) {
            for page in (sector..sector + SECTOR).step_by(PAGE) {
                pages.entry(page).or_insert([0; PAGE]);
            }
        }
        for (address, byte) in (start..end).zip(data) {
            let offset = address as usize % PAGE;
            let page = pages.get_mut(&(address - offset as u32)).expect("its sector was filled");
            page[offset] = *byte;
        }
    }
    if pages.is_empty() { Err("it has nothing for flash".to_owned()) } else { Ok(pages) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ELF file for Arm with segments at these addresses.
    fn elf_with(segments: &[(u32, &[u8])]) -> Vec<u8> {
        let mut file = vec![0x7f, b'E', b'L', b'F', 1, 1, 1];
        file.resize(16, 0);
        for half in [2_u16, 40] {
            file.extend(half.to_le_bytes());
        }
        for word in [1_u32, 0, 52, 0, 0] {
            file.extend(word.to_le_bytes());
        }
        for half in [52, 32, segments.len() as u16, 0, 0, 0] {
            file.extend(half.to_le_bytes());
        }
        let mut offset = 52 + 32 * segments.len() as u32;
        for (address, data) in segments {
            let length = data.len() as u32;
            for word in [1, offset, 0x2000_0000, *address, length, length, 5, 4] {
                file.extend(word.to_le_bytes());
            }
            offset += length;
        }
        segments.iter().for_each(|(_, data)| file.extend(*data));
        file
    }

    fn word(bytes: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn blocks_are_as_the_format_says_and_fill_every_sector() {
        let image = elf_with(&[(0x1000_0000, &[1; 300]), (0x1000_20f0, &[2; 32])]);
        let file = of_elf(&image, 0xe48b_ff56).unwrap();
        // A sector each; the one between them is left alone.
        assert_eq!(file.len(), 32 * 512);
        let addresses = (0x1000_0000..0x1000_1000).chain(0x1000_2000..0x1000_3000).step_by(256);
        for ((number, block), address) in file.chunks(512).enumerate().zip(addresses) {
            let words: Vec<u32> = (0..8).map(|i| word(block, 4 * i)).collect();
            let head =
                [0x0a32_4655, 0x9e5d_5157, 0x2000, address, 256, number as u32, 32, 0xe48b_ff56];
            assert_eq!(words, head);
            assert_eq!(word(block, 508), 0x0ab1_6f30);
        }
        let content = |block: usize| &file[512 * block + 32..512 * block + 32 + 256];
        assert_eq!(content(0), [1; 256]);
        assert_eq!(content(1), [[1; 44].as_slice(), &[0; 212]].concat());
        assert_eq!(content(16), [[0; 0xf0].as_slice(), &[2; 16]].concat());
        assert_eq!(content(17), [[2; 16].as_slice(), &[0; 240]].concat());
    }

    #[test]
    fn what_is_no_image_is_said() {
        for (image, expected) in [
            (b"nothing".to_vec(), "ELF"),
            (elf_with(&[]), "nothing for flash"),
            (elf_with(&[(0x2000_0000, &[1; 4])]), "0x20000000 does not lie in flash"),
            (elf_with(&[(0x10ff_fffe, &[1; 4])]), "0x10fffffe does not lie in flash"),
            (elf_with(&[(0x1000_0000, &[1; 4])])[..86].to_vec(), "outside of the file"),
        ] {
            let error = of_elf(&image, 0).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
