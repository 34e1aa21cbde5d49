//! `thermyo tune` of a joint.

use super::progress::Bar;
use super::tune::{Done, TuneArgs, interrupted};
use super::{Console, Failure, interrupt, title_of, unbuilt};
use model_core::joint::{JointConfig, JointTelemetry};
use thermyo_boards::live_joint::LiveJoint;
use thermyo_boards::subject::Subject;
use thermyo_joint::JointLoaded;
use thermyo_simulation::board::BoardError;
use thermyo_studies::drive::LiveBench;
use thermyo_studies::joint_tune::{
    self, Bench, BenchError, Course, Simulated, TuneError, Tuned, duration_s,
};
use thermyo_studies::tune::Left;

/// A bench that shows the driven time on a progress bar.
struct Watched<'a> {
    bench: &'a mut dyn Bench,
    bar: &'a Bar,
    /// Time driven before this experiment.
    before_ms: u64,
}

impl Bench for Watched<'_> {
    fn drive(
        &mut self,
        loaded: &JointLoaded,
        (course, duration_s): (Course<'_>, f64),
        each: &mut dyn FnMut(u32, &JointTelemetry),
    ) -> Result<(), BenchError> {
        let Self { bench, bar, before_ms } = self;
        let step_s = loaded.muscles[0].plant.run.step_s;
        bench.drive(loaded, (course, duration_s), &mut |step, telemetry| {
            bar.set_position(*before_ms + (f64::from(step) * step_s * 1e3) as u64);
            each(step, telemetry);
        })?;
        *before_ms += (duration_s * 1e3) as u64;
        Ok(())
    }

    fn leave(&mut self, left: Left<'_, JointConfig>) -> Result<(), BoardError> {
        self.bench.leave(left)
    }
}

fn tuned(loaded: &JointLoaded, args: &TuneArgs, highest_pa: f64) -> Result<Tuned, Failure> {
    let bar = Bar::new((duration_s(loaded, highest_pa) * 1e3) as u64, args.output.format.quiet);
    let tune_on = |bench: &mut dyn Bench| {
        let mut watched = Watched { bench, bar: &bar, before_ms: 0 };
        let tuned = joint_tune::tune_on(loaded, highest_pa, &mut watched);
        bar.clear();
        Ok(tuned?)
    };
    let stopped = &interrupt::is_requested;
    if let Some(port) = args.board.port() {
        let mut board = LiveJoint::open(port)?;
        return tune_on(&mut LiveBench::new(&mut board, "tune", highest_pa, stopped)?);
    }
    if !args.board.is_core() {
        let message = "a joint is tuned with the core in this process, or on a board at a PORT; without hardware \
                       `thermyo board emulated plug SCENARIO.toml`, then `--board port:emulated`";
        return Err(Failure::Usage(message.to_owned()));
    }
    tune_on(&mut Simulated { highest_pa, stopped })
}

pub(super) fn run(
    loaded: &JointLoaded,
    args: &TuneArgs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    if args.plan.is_some() {
        let message = "--plan motion finds slip and creep of one muscle: give a scenario without [joint], of either \
                       muscle alone";
        return Err(Failure::Usage(message.to_owned()));
    }
    unbuilt::refuse_joint(loaded, &args.scenario)?;
    let highest_pa = joint_tune::highest_pa(&loaded.config(), args.max_pressure)
        .map_err(|error| Failure::Usage(format!("--max-pressure: {error}")))?;
    interrupt::watch();
    let mut out = args.output.create("tune")?;
    let tuned = match tuned(loaded, args, highest_pa) {
        Err(Failure::Interrupted) => return Err(interrupted(&out, to)),
        tuned => tuned?,
    };
    let page = joint_tune::page(&tuned, &title_of(&args.scenario));
    let scenario = thermyo_joint::render(&tuned.scenario);
    let shown = (tuned.findings.text(), tuned.findings.adopted);
    Done::new(args, &mut out, &tuned.findings, (&scenario, &page), shown)?
        .failing(tuned.findings.values.failed())
        .publish(out, to)
}

impl From<TuneError> for Failure {
    fn from(error: TuneError) -> Self {
        match error {
            TuneError::Refused(refusal) => Self::JointTune(refusal),
            TuneError::Bench(BenchError::Run(error)) => Self::Joint(error),
            TuneError::Bench(BenchError::Board(error)) => Self::Board(error),
            TuneError::Bench(BenchError::Stopped) => Self::Interrupted,
            TuneError::Bench(error @ BenchError::Vented(_)) => Self::Check(error.to_string()),
        }
    }
}
