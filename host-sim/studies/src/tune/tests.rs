//! The values that a board is left with.

use super::*;
use model_core::Telemetry;
use thermyo_simulation::board::{BoardError, CoreBoard};

/// A simulated muscle that shakes in its last drive, the check with the tuned values.
struct Shaken {
    board: CoreBoard,
    drives: u32,
    shaken_m: f32,
    left: Option<Config>,
}

impl Bench for Shaken {
    fn drive(&mut self, driven: &Loaded, each: &mut dyn FnMut(&Telemetry)) -> Result<(), RunError> {
        self.drives += 1;
        let shaken_m = if self.drives == 3 { self.shaken_m } else { 0.0 };
        let mut bench = Simulated { board: &mut self.board, stopped: &|| false };
        bench.drive(driven, &mut |telemetry| {
            let mut telemetry = *telemetry;
            telemetry.length_m += if telemetry.step % 2 == 0 { shaken_m } else { -shaken_m };
            each(&telemetry);
        })
    }

    fn leave(&mut self, config: &Config) -> Result<(), BoardError> {
        self.left = Some(*config);
        Ok(())
    }
}

/// Values with which the muscle follows less closely were left on the board.
#[test]
fn values_that_are_worse_are_not_left_on_the_board() {
    let loaded =
        thermyo_setup::parse("[plant]\nmodel = \"lumped\"\n", Path::new("s.toml")).unwrap();
    for (shaken_m, adopted) in [(0.0, true), (0.5e-3, false)] {
        let mut bench = Shaken { board: CoreBoard::default(), drives: 0, shaken_m, left: None };
        let tuned = tune_on(&loaded, Path::new("s.toml"), HIGHEST_PA, &mut bench).unwrap();
        let headline = tuned.findings.headline();
        assert_eq!(tuned.findings.adopted, adopted, "{headline}");
        assert_eq!(headline.ends_with(": the former values are kept"), !adopted, "{headline}");
        assert_eq!(headline.contains(" less closely than before "), !adopted, "{headline}");
        let kept = if adopted { &tuned.scenario } else { &loaded };
        assert_eq!(bench.left, Some(core_config(&kept.believed)));
    }
}
