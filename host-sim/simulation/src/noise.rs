//! Gaussian noise, the same numbers on every machine.
//!
//! `rand_distr` has the same algorithm, but takes exponentials and logarithms from the platform.

use rand_distr::{Distribution, Open01, StandardUniform};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::Rng;
use std::sync::LazyLock;
use thermyo_compute::math;

/// Layers of equal area, and start and area of the tail (J. A. Doornik, "An improved ziggurat
/// method to generate normal random samples", 2005).
const LAYERS: usize = 256;
const TAIL: f64 = 3.654152885361009;
const AREA: f64 = 0.00492867323399;

/// Half widths of the layers, and the densities there.
struct Ziggurat {
    widths: [f64; LAYERS + 1],
    heights: [f64; LAYERS + 1],
}

static ZIGGURAT: LazyLock<Ziggurat> = LazyLock::new(|| {
    let mut widths = [0.0; LAYERS + 1];
    widths[0] = AREA / bell(TAIL);
    widths[1] = TAIL;
    for i in 2..LAYERS {
        let before: f64 = widths[i - 1];
        widths[i] = (-2.0 * math::log(AREA / before + bell(before))).sqrt();
    }
    Ziggurat { widths, heights: widths.map(bell) }
});

fn bell(x: f64) -> f64 {
    math::exp(-0.5 * x * x)
}

/// A number of mean 0 and deviation 1.
pub fn standard_normal(random: &mut Xoshiro256PlusPlus) -> f64 {
    let Ziggurat { widths, heights } = &*ZIGGURAT;
    loop {
        let bits = random.next_u64();
        // The lowest bits choose a layer, the highest ones a position in it from -1 to 1.
        let layer = (bits & 0xff) as usize;
        let place = f64::from_bits((bits >> 12) | 2.0_f64.to_bits()) - 3.0;
        let x = place * widths[layer];
        if x.abs() < widths[layer + 1] {
            return x;
        }
        if layer == 0 {
            return tail(random).copysign(place);
        }
        let share: f64 = StandardUniform.sample(random);
        if heights[layer + 1] + (heights[layer] - heights[layer + 1]) * share < bell(x) {
            return x;
        }
    }
}

/// The tail beyond the first layer (G. Marsaglia, "Generating a variable from the tail of the
/// normal distribution", 1964).
fn tail(random: &mut Xoshiro256PlusPlus) -> f64 {
    loop {
        let [x, y]: [f64; 2] = [Open01.sample(random), Open01.sample(random)].map(math::log);
        let beyond = -x / TAIL;
        if -2.0 * y >= beyond * beyond {
            return TAIL + beyond;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::StandardNormal;
    use rand_xoshiro::rand_core::SeedableRng;

    #[test]
    fn it_is_that_of_rand_distr_but_for_rounding() {
        let mut ours = Xoshiro256PlusPlus::seed_from_u64(7);
        let mut theirs = ours.clone();
        let mut beyond = 0;
        for _ in 0..1_000_000 {
            let (a, b): (f64, f64) =
                (standard_normal(&mut ours), StandardNormal.sample(&mut theirs));
            assert!((a - b).abs() < 1e-11, "{a} for {b}");
            beyond += u32::from(a.abs() > TAIL);
        }
        // The expected number is 258.
        assert!((200..320).contains(&beyond), "{beyond}");
    }
}
