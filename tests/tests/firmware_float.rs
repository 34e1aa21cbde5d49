//! The firmware's own soft-float against the host's FPU, to the bit.

#[allow(dead_code)]
#[path = "../../firmware/src/float.rs"]
mod float;

/// Number pairs per kind.
const PAIRS: u32 = 3_000_000;

/// xorshift64 (Marsaglia 2003).
struct Random(u64);

impl Random {
    fn pair(&mut self) -> (u32, u32) {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 as u32, (self.0 >> 32) as u32)
    }
}

/// `b` with an exponent at most 15 from that of `a`.
fn near(a: u32, b: u32) -> u32 {
    let exponent = (a >> 23).wrapping_add((b >> 23) % 31).wrapping_sub(15) & 0xff;
    b & 0x807f_ffff | exponent << 23
}

/// Makes a pair of a kind out of any pair.
type Shape = fn(u32, u32) -> (u32, u32);

#[test]
fn sums_and_products_are_those_of_the_fpu() {
    let kinds: [(&str, Shape); 4] = [
        ("any", |a, b| (a, b)),
        ("alike", |a, b| (a, near(a, b))),
        ("short, so that ties occur", |a, b| (a & !0xfff, near(a, b) & !0x7fff)),
        ("neighbours, so that digits cancel", |a, b| (a, a ^ b & 0x8000_0007)),
    ];
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    for (kind, shape) in kinds {
        let mut answered = [0; 2];
        for _ in 0..PAIRS {
            let (a, b) = random.pair();
            let (a, b) = shape(a, b);
            let (x, y) = (f32::from_bits(a), f32::from_bits(b));
            for (count, result, expected) in
                [(0, float::add(a, b), x + y), (1, float::multiply(a, b), x * y)]
            {
                if let Some(bits) = result {
                    answered[count] += 1;
                    assert_eq!(bits, expected.to_bits(), "{kind}: {a:#010x}, {b:#010x}");
                }
            }
        }
        // Rare cases may be left to the compiler, and only they.
        assert!(answered[0] > PAIRS / 10 * 9, "{kind}: {} sums", answered[0]);
        assert!(answered[1] > PAIRS / 10 * 4, "{kind}: {} products", answered[1]);
    }
}

#[test]
fn the_usual_numbers_are_answered() {
    for (x, y) in [(1.0_f32, 2.0_f32), (298.15, -0.001), (1.0e5, 1.0e-9), (-3.5, 3.5), (0.1, 0.0)] {
        let (a, b) = (x.to_bits(), y.to_bits());
        assert_eq!(float::add(a, b), Some((x + y).to_bits()));
        assert_eq!(float::add(b, a), Some((x + y).to_bits()));
        if y != 0.0 {
            assert_eq!(float::multiply(a, b), Some((x * y).to_bits()));
        }
    }
}
