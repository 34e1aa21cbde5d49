//! A board of one muscle or of a joint, as programs for both need it.

use super::live::LiveBoard;
use super::live_joint::LiveJoint;
use model_core::control::Mode;
use model_core::joint::{JointConfig, JointMode, JointSetPoint, JointTelemetry};
use model_core::safety::supervisor::VENTING;
use model_core::{Config, Faults, SetPoint, Telemetry};
use thermyo_protocol::{Status, Timing, Version};
use thermyo_simulation::board::BoardError;

/// A live board, and what its telemetry states.
pub trait Subject: Sized + Send + 'static {
    type Config: Copy + PartialEq + Send;
    type Telemetry: Copy + Send;
    type SetPoint: Copy + PartialEq + Send;

    /// Opens the board at a port.
    ///
    /// # Errors
    /// [`BoardError`], if there is no answer, another protocol, or another image.
    fn open(port: &str) -> Result<Self, BoardError>;

    fn version(&self) -> Version;

    fn status(&mut self) -> Result<Status, BoardError>;

    fn timing(&mut self) -> Result<Timing, BoardError>;

    /// The configuration in use.
    fn config(&mut self) -> Result<Self::Config, BoardError>;

    /// Sends a configuration and its name.
    fn configure(&mut self, config: &Self::Config, name: &str) -> Result<Status, BoardError>;

    /// Saves the configuration in use in flash.
    fn save(&mut self) -> Result<(), BoardError>;

    /// Arms up to this absolute pressure \[Pa\], or as far as configured.
    fn arm(&mut self, most_pa: Option<f32>) -> Result<(), BoardError>;

    /// Sends a set point; returns the step from which on it holds.
    fn set(&mut self, set_point: Self::SetPoint) -> Result<u32, BoardError>;

    /// Clears the latched faults whose cause is gone, without reading telemetry.
    fn forget_faults(&mut self) -> Result<(), BoardError>;

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
        fn open(port: &str) -> Result<Self, BoardError> {
            <$board>::open(port)
        }

        fn version(&self) -> Version {
            <$board>::version(self)
        }

        fn status(&mut self) -> Result<Status, BoardError> {
            <$board>::status(self)
        }

        fn timing(&mut self) -> Result<Timing, BoardError> {
            <$board>::timing(self)
        }

        fn config(&mut self) -> Result<Self::Config, BoardError> {
            <$board>::config(self)
        }

        fn configure(&mut self, config: &Self::Config, name: &str) -> Result<Status, BoardError> {
            <$board>::configure(self, config, name)
        }

        fn save(&mut self) -> Result<(), BoardError> {
            <$board>::save(self)
        }

        fn arm(&mut self, most_pa: Option<f32>) -> Result<(), BoardError> {
            <$board>::arm(self, most_pa)
        }

        fn set(&mut self, set_point: Self::SetPoint) -> Result<u32, BoardError> {
            <$board>::set(self, set_point)
        }

        fn forget_faults(&mut self) -> Result<(), BoardError> {
            <$board>::forget_faults(self)
        }

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
    type Config = Config;
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
    type Config = JointConfig;
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
