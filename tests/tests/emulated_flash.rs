//! `thermyo flash`: from a running board through its boot loader to a board that runs the written file; and its
//! messages about everything that cannot be flashed.
#![cfg(unix)]

use host_sim::commands::flash::{FlashError, Model, Request, run};
use model_core::{AdcCode, Sample};
use std::path::{Path, PathBuf};
use std::time::Duration;
use std::{fs, thread};
use system_tests::thermyo;
use thermyo_boards::emulated::EmulatedBoard;
use thermyo_boards::pty::PtyBoard;

const HEALTHY: Sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
const PICO: &str = "UF2 Bootloader v3.0\r\nModel: Raspberry Pi RP2\r\nBoard-ID: RPI-RP2\r\n";
const PICO_2: &str = "UF2 Bootloader v1.0\r\nModel: Raspberry Pi RP2350\r\nBoard-ID: RP2350\r\n";
/// Family of a UF2 file, by its chip.
const FAMILIES: [(&str, u32); 2] = [(PICO, 0xe48b_ff56), (PICO_2, 0xe48b_ff59)];

fn drive(folder: &Path, info: &str) -> PathBuf {
    let drive = folder.join("drive");
    fs::create_dir_all(&drive).unwrap();
    fs::write(drive.join("INFO_UF2.TXT"), info).unwrap();
    drive
}

fn request(target: &str) -> Request {
    Request { target: Some(target.to_owned()), ..Request::default() }
}

/// Output or error of a run in which boards appear as drives in this folder.
fn flash(request: &Request, mount: &Path) -> Result<Vec<String>, FlashError> {
    let mut output = Vec::new();
    run(request, &|| vec![mount.to_path_buf()], &mut |line| output.push(line.to_owned()))
        .map(|_| output)
}

#[test]
#[cfg_attr(not(emulator), ignore = "THERMYO_SKIP_EMULATOR=1")]
fn a_running_board_is_flashed_and_runs_the_new_image() {
    let folder = tempfile::tempdir().unwrap();
    let (port, mount) = (folder.path().join("port"), folder.path().join("drive"));
    let plug_in = |board: EmulatedBoard| {
        let pty = PtyBoard::new(board, HEALTHY).unwrap();
        let _ = fs::remove_file(&port);
        std::os::unix::fs::symlink(pty.port(), &port).unwrap();
        pty
    };
    let mut running = plug_in(EmulatedBoard::new().unwrap());
    let name = port.display().to_string();
    let output = thread::scope(|scope| {
        let flashing = scope.spawn(|| flash(&request(&name), &mount));
        // The board is a drive now, until it gets a file.
        while !running.in_boot_loader() {
            assert!(!flashing.is_finished(), "{:?}", flashing.join());
            thread::sleep(Duration::from_millis(20));
        }
        fs::remove_file(&port).unwrap();
        drive(folder.path(), PICO);
        let file = mount.join("thermyo.uf2");
        let whole = |bytes: &[u8]| {
            let count =
                bytes.get(24..28).map(|count| u32::from_le_bytes(count.try_into().unwrap()));
            count.is_some_and(|count| bytes.len() == 512 * count as usize)
        };
        while !fs::read(&file).is_ok_and(|bytes| whole(&bytes)) {
            thread::sleep(Duration::from_millis(20));
        }
        let uf2 = folder.path().join("taken.uf2");
        fs::copy(&file, &uf2).unwrap();
        fs::remove_dir_all(&mount).unwrap();
        running = plug_in(EmulatedBoard::with_image(&uf2).unwrap());
        flashing.join().unwrap().unwrap()
    });
    let version = env!("CARGO_PKG_VERSION");
    let last = output.last().unwrap();
    assert!(last.starts_with(&format!("{name} runs firmware {version} (RP2040, ")), "{output:#?}");
    assert!(
        output.iter().any(|line| line.ends_with("restarts into its boot loader")),
        "{output:#?}"
    );
    drop(running);
}

#[test]
#[cfg_attr(not(emulator), ignore = "THERMYO_SKIP_EMULATOR=1")]
fn a_dry_run_leaves_the_board_alone() {
    let pty = PtyBoard::new(EmulatedBoard::new().unwrap(), HEALTHY).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let dry = Request { dry_run: true, ..request(pty.port()) };
    let output = flash(&dry, folder.path()).unwrap();
    assert!(output.last().unwrap().starts_with("would write "), "{output:#?}");
    assert!(!pty.in_boot_loader());
}

/// Files of both chips: every block is of the drive's family, and the blocks are all there.
#[test]
fn a_drive_gets_the_firmware_of_its_chip() {
    for (info, family) in FAMILIES {
        let folder = tempfile::tempdir().unwrap();
        let drive = drive(folder.path(), info);
        let output = thermyo(&["flash", &drive.display().to_string()]);
        assert_eq!(output.code, 0, "{}", output.err);
        assert!(
            output.out.ends_with("a folder, and no drive: no board restarts\n"),
            "{}",
            output.out
        );
        let file = fs::read(drive.join("thermyo.uf2")).unwrap();
        let word =
            |block: &[u8], at: usize| u32::from_le_bytes(block[at..at + 4].try_into().unwrap());
        assert!((120..=660).contains(&(file.len() / 512)), "{} blocks", file.len() / 512);
        for (number, block) in (0..).zip(file.chunks(512)) {
            assert_eq!((word(block, 20), word(block, 28)), (number, family));
        }
    }
}

#[test]
fn a_bad_image_is_refused_in_one_line_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (empty, other, pico) =
        (folder.path().join("empty"), folder.path().join("other"), folder.path().join("pico"));
    fs::create_dir(&empty).unwrap();
    let other = drive(&other, "Board-ID: SAMD21G18A\n");
    let pico = drive(&pico, PICO);
    let text = |path: &Path| path.display().to_string();
    for (arguments, expected) in [
        (vec!["/dev/thermyo-nowhere"], "/dev/thermyo-nowhere: "),
        (vec![&text(&empty)], "has no INFO_UF2.TXT"),
        (vec![&text(&other)], "Board-ID \"SAMD21G18A\": must be RPI-RP2 (Pico) or RP2350 (Pico 2)"),
        (vec![&text(&pico), "--chip", "pico2"], "is a pico: leave --chip pico2 out"),
        (vec![&text(&pico), "--chip", "nucleo"], "possible values: pico, pico2"),
    ] {
        let outcome = thermyo(&[&["flash"], arguments.as_slice()].concat());
        assert_eq!((outcome.code, outcome.out.as_str()), (2, ""), "{arguments:?}: {}", outcome.err);
        assert!(outcome.err.contains(expected), "{arguments:?}: {}", outcome.err);
    }
    for drive in [&empty, &other, &pico] {
        assert!(!drive.join("thermyo.uf2").exists());
    }
    let outcome = thermyo(&["flash", &text(&pico), "--chip", "pico", "--dry-run"]);
    assert_eq!(outcome.code, 0, "{}", outcome.err);
    assert!(outcome.out.contains("would write") && !pico.join("thermyo.uf2").exists());
}

#[test]
fn a_port_without_an_answer_is_named() {
    let (_master, slave) = serialport::TTYPort::pair().unwrap();
    let name = serialport::SerialPort::name(&slave).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let error = flash(&request(&name), folder.path()).unwrap_err().to_string();
    assert!(error.contains("nothing answers as Thermyo") && error.contains("BOOTSEL"), "{error}");
}

#[test]
fn without_a_name_the_only_board_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| drive(&folder.path().join(name), PICO));
    let dry = |mounts: Vec<PathBuf>| {
        let mut output = Vec::new();
        let request =
            Request { joint: false, dry_run: true, model: Some(Model::Pico), target: None };
        run(&request, &move || mounts.clone(), &mut |line| output.push(line.to_owned()))
            .map(|_| output)
    };
    let several = dry(vec![a.clone(), b]).unwrap_err();
    assert!(matches!(&several, FlashError::Several(names) if names.len() == 2), "{several}");
    let output = dry(vec![a.clone(), folder.path().to_path_buf()]).unwrap();
    assert!(output.last().unwrap().contains(&a.display().to_string()), "{output:?}");
}
