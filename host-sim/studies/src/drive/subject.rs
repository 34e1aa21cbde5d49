//! A board of one muscle or of a joint, as a drive needs it.

use model_core::control::Mode;
use model_core::joint::{JointMode, JointSetPoint, JointTelemetry};
use model_core::safety::supervisor::VENTING;
use model_core::{Faults, SetPoint, Telemetry};
use thermyo_boards::live::LiveBoard;
use thermyo_boards::live_joint::LiveJoint;
use thermyo_protocol::Status;
use thermyo_simulation::board::BoardError;

/// Set points over the steps of a drive.
pub trait Course<P> {
    /// Steps that are driven.
    fn steps(&self) -> u64;

    /// Ambient pressure that the board is configured with \[Pa\].
    fn ambient_pa(&self) -> f32;

    /// The set point of step 0.
    fn first(&self) -> P;

    /// A set point that begins at a step.
    fn acting_from(&self, step: u64) -> Option<P>;
}

/// A live board, and what its telemetry states.
pub trait Subject {
    type Telemetry;
    type SetPoint;

    fn telemetry_every(&mut self, steps: u16) -> Result<(), BoardError>;

    /// Restarts the core, with this set point in its step 0.
    fn start(&mut self, set_point: Self::SetPoint) -> Result<(), BoardError>;

    /// Sends a set point without waiting for the answer; returns the number of the request.
    fn send(&mut self, set_point: Self::SetPoint) -> Result<u8, BoardError>;

    /// Returns the refusal of a request that was only sent, if there is one.
    fn check(&mut self, sequence: u8) -> Result<(), BoardError>;

    fn poll(&mut self) -> Result<Option<Self::Telemetry>, BoardError>;

    /// Whether unread telemetry has arrived.
    fn is_behind(&self) -> bool;

    fn last_status(&self) -> Option<Status>;

    /// Vents, without reading telemetry.
    fn vent(&mut self) -> Result<(), BoardError>;

    /// Vents; returns when it is confirmed.
    fn stop(&mut self) -> Result<(), BoardError>;

    fn step(telemetry: &Self::Telemetry) -> u32;

    fn is_checking(telemetry: &Self::Telemetry) -> bool;

    /// The highest pressure \[Pa\].
    fn pressure_pa(telemetry: &Self::Telemetry) -> f32;

    /// Faults that vent.
    fn venting(telemetry: &Self::Telemetry) -> Faults;
}

/// The methods that both boards have by the same name.
macro_rules! methods_of {
    ($board:ty) => {
        fn telemetry_every(&mut self, steps: u16) -> Result<(), BoardError> {
            <$board>::telemetry_every(self, steps)
        }

        fn start(&mut self, set_point: Self::SetPoint) -> Result<(), BoardError> {
            <$board>::start(self, set_point)
        }

        fn send(&mut self, set_point: Self::SetPoint) -> Result<u8, BoardError> {
            <$board>::send(self, set_point)
        }

        fn check(&mut self, sequence: u8) -> Result<(), BoardError> {
            <$board>::check(self, sequence)
        }

        fn poll(&mut self) -> Result<Option<Self::Telemetry>, BoardError> {
            <$board>::poll(self)
        }

        fn is_behind(&self) -> bool {
            <$board>::is_behind(self)
        }

        fn last_status(&self) -> Option<Status> {
            <$board>::last_status(self)
        }

        fn stop(&mut self) -> Result<(), BoardError> {
            <$board>::stop(self)
        }
    };
}

impl Subject for LiveBoard {
    type Telemetry = Telemetry;
    type SetPoint = SetPoint;

    methods_of!(LiveBoard);

    fn vent(&mut self) -> Result<(), BoardError> {
        Self::vent(self)
    }

    fn step(telemetry: &Telemetry) -> u32 {
        telemetry.step
    }

    fn is_checking(telemetry: &Telemetry) -> bool {
        telemetry.mode == Mode::StartupCheck
    }

    fn pressure_pa(telemetry: &Telemetry) -> f32 {
        telemetry.pressure_pa
    }

    fn venting(telemetry: &Telemetry) -> Faults {
        telemetry.faults.of(VENTING)
    }
}

impl Subject for LiveJoint {
    type Telemetry = JointTelemetry;
    type SetPoint = JointSetPoint;

    methods_of!(LiveJoint);

    fn vent(&mut self) -> Result<(), BoardError> {
        self.stop()
    }

    fn step(telemetry: &JointTelemetry) -> u32 {
        telemetry.step()
    }

    fn is_checking(telemetry: &JointTelemetry) -> bool {
        telemetry.mode == JointMode::StartupCheck
    }

    fn pressure_pa(telemetry: &JointTelemetry) -> f32 {
        let [a, b] = telemetry.muscles.map(|muscle| muscle.pressure_pa);
        a.max(b)
    }

    fn venting(telemetry: &JointTelemetry) -> Faults {
        let [a, b] = telemetry.muscles.map(|muscle| muscle.faults.of(VENTING));
        a.with(b).with(telemetry.faults.of_failure())
    }
}
