//! A zip archive of a few files, stored: compression would take ten more crates into every build.

/// Version 2.0, which the fields here need.
const VERSION: u16 = 20;
/// Names are UTF-8.
const FLAGS: u16 = 1 << 11;
/// The earliest date: a time stamp would make every archive different.
const DATE: u16 = 0x21;

/// The archive of files of names and contents, less than 4 GiB.
pub(super) fn stored(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut archive = Vec::new();
    let mut directory = Vec::new();
    for (name, content) in files {
        let offset = archive.len() as u32;
        let [crc, size] = [crc32fast::hash(content), content.len() as u32];
        // Version, flags, no compression, time and date.
        let mut shared = shorts(&[VERSION, FLAGS, 0, 0, DATE]);
        shared.extend([crc, size, size].into_iter().flat_map(u32::to_le_bytes));
        shared.extend(shorts(&[name.len() as u16, 0]));
        for part in [b"PK\x03\x04", &shared[..], name.as_bytes(), content] {
            archive.extend_from_slice(part);
        }
        // Made on Unix: the mode follows. No comment, first disk, no hint about the content.
        let made = shorts(&[3 << 8 | VERSION]);
        let mut rest = shorts(&[0, 0, 0]);
        rest.extend([0o100_644 << 16, offset].into_iter().flat_map(u32::to_le_bytes));
        for part in [b"PK\x01\x02", &made[..], &shared, &rest, name.as_bytes()] {
            directory.extend_from_slice(part);
        }
    }
    let [start, size] = [archive.len() as u32, directory.len() as u32].map(u32::to_le_bytes);
    let count = files.len() as u16;
    archive.extend(directory);
    let counts = shorts(&[0, 0, count, count]);
    for part in [b"PK\x05\x06", &counts[..], &size, &start, &[0, 0]] {
        archive.extend_from_slice(part);
    }
    archive
}

fn shorts(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Cursor, Read};
    use zip::ZipArchive;

    #[test]
    fn a_reader_finds_every_file_whole() {
        let files = [("a/b.txt", &b"first"[..]), ("empty", b""), ("pfad/\u{fc}.bin", &[7; 70_000])]
            .map(|(name, content)| (name.to_owned(), content.to_vec()));
        let mut archive = ZipArchive::new(Cursor::new(stored(&files))).unwrap();
        assert_eq!(archive.len(), files.len());
        for (name, content) in &files {
            let mut file = archive.by_name(name).unwrap();
            assert_eq!(file.unix_mode(), Some(0o100_644));
            let mut read = Vec::new();
            // Reading to the end compares the checksum.
            file.read_to_end(&mut read).unwrap();
            assert_eq!(&read, content);
        }
    }
}
