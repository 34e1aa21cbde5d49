//! System tests live in `tests/`.

/// Whether the tests on the emulated board are to be left out; says so.
pub fn skip_emulator() -> bool {
    let skip = std::env::var_os("THERMYO_SKIP_EMULATOR").is_some_and(|value| value == "1");
    if skip {
        eprintln!("skipped: THERMYO_SKIP_EMULATOR=1");
    }
    skip
}
