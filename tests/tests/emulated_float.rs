//! The arithmetic in the firmware's image, called on the emulated chip, against the host's FPU.

use object::{Object, ObjectSymbol};
use std::io::{BufWriter, Read, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use system_tests::float_pairs::{KINDS, Random, edge_pairs, same};
use thermyo_boards::image::{Variant, firmware, prepare_emulator};

/// Number pairs per operation and kind.
const PAIRS: usize = 40_000;

/// A name that compiled code calls, and a function for its expected result.
type Operation = (&'static str, fn(f32, f32) -> f32);

const ARITHMETIC: [Operation; 4] = [
    ("__aeabi_fadd", |x, y| x + y),
    ("__aeabi_fsub", |x, y| x - y),
    ("__aeabi_fmul", |x, y| x * y),
    ("__aeabi_fdiv", |x, y| x / y),
];

const COMPARISONS: [Operation; 4] = [
    ("__aeabi_fcmplt", |x, y| truth(x < y)),
    ("__aeabi_fcmple", |x, y| truth(x <= y)),
    ("__aeabi_fcmpgt", |x, y| truth(x > y)),
    ("__aeabi_fcmpge", |x, y| truth(x >= y)),
];

fn truth(is: bool) -> f32 {
    f32::from_bits(u32::from(is))
}

/// A call of a function with two arguments; and the arguments of another call of it, by an
/// interrupt after this many instructions.
struct Call {
    arguments: (u32, u32),
    interrupt: Option<(u32, (u32, u32))>,
}

/// Result and cycles of a call.
struct Outcome {
    result: u32,
    cycles: u32,
}

/// The image, and the addresses of its functions.
struct Image {
    scripts: PathBuf,
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Image {
    fn new() -> Self {
        let scripts = prepare_emulator().unwrap();
        let path = firmware(Variant::Standard).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        Self { scripts, path, bytes }
    }

    fn call(&self, name: &str, calls: &[Call]) -> Vec<Outcome> {
        let file = object::File::parse(&*self.bytes).unwrap();
        let symbol = file.symbols().find(|symbol| symbol.name() == Ok(name));
        let address = symbol.unwrap_or_else(|| panic!("no {name}")).address() as u32;
        let mut emulator = Command::new("node")
            .arg(self.scripts.join("call.mjs"))
            .arg(&self.path)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut requests = BufWriter::new(emulator.stdin.take().unwrap());
        let mut responses = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for Call { arguments: (a, b), interrupt } in calls {
                    let (after, (c, d)) = interrupt.unwrap_or_default();
                    for word in [address, *a, *b, after, c, d] {
                        requests.write_all(&word.to_le_bytes()).unwrap();
                    }
                }
                requests.flush().unwrap();
            });
            emulator.stdout.take().unwrap().read_to_end(&mut responses).unwrap();
        });
        assert!(emulator.wait().unwrap().success(), "{name}");
        let (words, _) = responses.as_chunks::<4>();
        let words: Vec<_> = words.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
        assert_eq!(words.len(), 2 * calls.len());
        words.chunks(2).map(|pair| Outcome { result: pair[0], cycles: pair[1] }).collect()
    }

    /// Compares results for pairs of a kind; returns the mean cycles.
    fn compare(&self, (name, fpu): Operation, kind: &str, pairs: &[(u32, u32)]) -> f64 {
        let calls: Vec<_> =
            pairs.iter().map(|&arguments| Call { arguments, interrupt: None }).collect();
        let outcomes = self.call(name, &calls);
        let mut cycles = 0.0;
        for (&(a, b), outcome) in pairs.iter().zip(&outcomes) {
            let expected = fpu(f32::from_bits(a), f32::from_bits(b));
            let result = outcome.result;
            assert!(
                same(result, expected),
                "{name} of {kind}: {a:#010x}, {b:#010x} is {result:#010x}, not {:#010x}",
                expected.to_bits()
            );
            cycles += f64::from(outcome.cycles);
        }
        println!("{name} of {kind}: {:.1} cycles", cycles / pairs.len() as f64);
        cycles / pairs.len() as f64
    }
}

#[test]
fn results_are_those_of_the_fpu() {
    let image = Image::new();
    let edges: Vec<_> = edge_pairs().collect();
    let mut random = Random(0x2545_f491_4f6c_dd1d);
    for operation in ARITHMETIC.into_iter().chain(COMPARISONS) {
        for (kind, shape) in KINDS {
            let pairs: Vec<_> = random.by_ref().take(PAIRS).map(|(a, b)| shape(a, b)).collect();
            image.compare(operation, kind, &pairs);
        }
        image.compare(operation, "edges", &edges);
    }
}

/// Cycles include the function's return, but not the call.
#[test]
fn the_usual_numbers_take_few_cycles() {
    let image = Image::new();
    // Numbers from 2^-15 to 2, of either sign.
    let usual = |x: u32| x & 0x87ff_ffff | 0x3800_0000;
    let pairs: Vec<_> = Random(1).take(10_000).map(|(a, b)| (usual(a), usual(b))).collect();
    let most = [46.0, 49.0, 55.0, 78.0, 22.0, 22.0, 19.0, 19.0];
    for (operation, most) in ARITHMETIC.into_iter().chain(COMPARISONS).zip(most) {
        let cycles = image.compare(operation, "usual numbers", &pairs);
        assert!((8.0..most).contains(&cycles), "{cycles}");
    }
}

#[test]
fn an_interrupt_that_divides_does_no_harm() {
    let image = Image::new();
    let pairs = [(0x3f80_0000, 0x4040_0000), (0x4123_4567, 0xbf98_7654)];
    let other = (0x42c8_0000, 0x3fff_ffff);
    for arguments in pairs {
        let calls: Vec<_> =
            (1..70).map(|after| Call { arguments, interrupt: Some((after, other)) }).collect();
        let outcomes = image.call("__aeabi_fdiv", &calls);
        let expected = f32::from_bits(arguments.0) / f32::from_bits(arguments.1);
        for (after, outcome) in (1..).zip(&outcomes) {
            assert_eq!(outcome.result, expected.to_bits(), "after {after} instructions");
        }
        // Some interrupts came between the divider's start and its answer, so that the division was
        // repeated.
        let again = outcomes.iter().filter(|outcome| outcome.cycles > outcomes[0].cycles).count();
        assert!((10..30).contains(&again), "{again}");
    }
}
