//! The image itself: its size, and what must not be in it.

use host_sim::board::image::{Variant, firmware, prepare_emulator};
use host_sim::board::{BoardError, emulated::EmulatedBoard};
use object::{Object, ObjectSection, ObjectSymbol};
use system_tests::skip_emulator;

/// Flash of the image \[bytes\].
const FLASH: u64 = 128 * 1024;
/// Static memory of the image \[bytes\].
const RAM: u64 = 24 * 1024;

#[test]
fn the_image_fits_and_has_neither_double_precision_nor_a_heap() {
    if skip_emulator() {
        return;
    }
    let bytes = std::fs::read(firmware(Variant::Standard).unwrap()).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let size = |names: &[&str]| -> u64 {
        let named = |section: &object::Section| names.contains(&section.name().unwrap_or(""));
        file.sections().filter(named).map(|section| section.size()).sum()
    };
    let flash = size(&[".boot2", ".vector_table", ".text", ".rodata", ".data"]);
    let ram = size(&[".data", ".bss", ".uninit"]);
    println!("{flash} bytes of flash, {ram} bytes of static memory");
    assert!((20_000..=FLASH).contains(&flash), "{flash} bytes of flash");
    assert!((2_000..=RAM).contains(&ram), "{ram} bytes of static memory");

    let names: Vec<&str> = file.symbols().filter_map(|symbol| symbol.name().ok()).collect();
    assert!(names.iter().any(|name| name.contains("aeabi_fmul")), "no symbols to look at");
    // The last are embassy's functions on the divider, which the division of `float.s` has for itself.
    let never = ["__aeabi_d", "__rust_alloc", "_erphal_"];
    let unwanted: Vec<_> =
        names.iter().filter(|name| never.iter().any(|part| name.contains(part))).collect();
    assert!(unwanted.is_empty(), "{unwanted:?}");
}

#[test]
fn what_is_no_image_is_named() {
    if skip_emulator() {
        return;
    }
    prepare_emulator().unwrap();
    let folder = std::env::temp_dir().join(format!("thermyo-image-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let error = |name: &str, content: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, content).unwrap();
        EmulatedBoard::with_image(&path).err().map(|error| error.to_string()).unwrap()
    };
    let text = error("notes.txt", &[b'x'; 600]);
    assert!(text.contains("neither an ELF nor a UF2"), "{text}");
    // A block of a UF2 file of the RP2350's family.
    let mut block = [0_u8; 512];
    for (offset, word) in [
        (0, 0x0a32_4655_u32),
        (4, 0x9e5d_5157),
        (8, 0x2000),
        (12, 0x1000_0000),
        (16, 256),
        (24, 1),
        (28, 0xe48b_ff59),
        (508, 0x0ab1_6f30),
    ] {
        block[offset..offset + 4].copy_from_slice(&word.to_le_bytes());
    }
    let text = error("pico2.uf2", &block);
    assert!(text.contains("another chip") && text.contains("`pico`"), "{text}");
    // This very program.
    let program = std::fs::read(std::env::current_exe().unwrap()).unwrap();
    let text = error("program", &program);
    assert!(text.contains("another processor") || text.contains("neither"), "{text}");
    let missing = EmulatedBoard::with_image(&folder.join("nothing")).err().unwrap();
    assert!(matches!(missing, BoardError::NoImage { .. }), "{missing}");
    std::fs::remove_dir_all(&folder).unwrap();
}
