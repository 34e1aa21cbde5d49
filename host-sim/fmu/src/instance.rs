//! An instance and its log.

use std::ffi::{CStr, CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::ptr;
use thermyo_cosimulation::description::token;
use thermyo_cosimulation::model::{Model, ModelError};

/// `fmi3Status`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    Ok = 0,
    /// Not done, without any effect.
    Discard = 2,
    /// Not done, and the instance cannot continue.
    Error = 3,
    /// The whole library cannot continue.
    Fatal = 4,
}

/// `fmi3LogMessageCallback`.
pub type LogMessage = unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char);

/// The importer's log callback.
#[derive(Clone, Copy)]
struct Log {
    environment: *mut c_void,
    message: Option<LogMessage>,
}

impl Log {
    fn say(self, status: Status, text: &str) {
        let (Some(message), Ok(text)) = (self.message, CString::new(text)) else { return };
        // Safety: the importer's own function with its own environment.
        unsafe { message(self.environment, status, c"logStatusError".as_ptr(), text.as_ptr()) };
    }
}

pub struct Instance {
    model: Model,
    log: Log,
}

impl Instance {
    /// Creates an instance from the unit's resources; null, and a message, if that fails.
    ///
    /// # Safety
    /// Texts end with a zero byte, or are null.
    pub unsafe fn make(
        given: *const c_char,
        resources: *const c_char,
        environment: *mut c_void,
        message: Option<LogMessage>,
    ) -> *mut Self {
        let log = Log { environment, message };
        // Safety: the caller's.
        let (given, resources) = unsafe { (text(given), text(resources)) };
        let made = catch_unwind(|| {
            let model = Model::load(Path::new(&resources)).map_err(|error| error.to_string())?;
            let own = token(&model);
            if own == given {
                Ok(model)
            } else {
                Err(format!(
                    "instantiationToken {given:?}: must be {own:?}, that of these resources"
                ))
            }
        });
        match made.unwrap_or_else(|_| Err(BROKEN.to_owned())) {
            Ok(model) => Box::into_raw(Box::new(Self { model, log })),
            Err(error) => {
                log.say(Status::Error, &error);
                ptr::null_mut()
            }
        }
    }

    /// Logs that the unit does not support a function.
    pub fn refuse(&self, name: &str) -> Status {
        self.log.say(Status::Error, &format!("{name}: this unit has no such thing"));
        Status::Error
    }
}

/// The message after a panic.
const BROKEN: &str = "the unit has failed; this is a mistake of it and not of its importer";

/// Runs a function of the model, and logs its error.
///
/// # Safety
/// The instance is one of this library, and is not in use elsewhere.
pub unsafe fn guarded(
    instance: *mut Instance,
    ask: impl FnOnce(&mut Model) -> Result<(), ModelError>,
) -> Status {
    // Safety: the caller's.
    let Some(Instance { model, log }) = (unsafe { instance.as_mut() }) else {
        return Status::Error;
    };
    match catch_unwind(AssertUnwindSafe(|| ask(model))) {
        Ok(Ok(())) => Status::Ok,
        Ok(Err(error)) => {
            let status = if error.leaves_all() { Status::Discard } else { Status::Error };
            log.say(status, &error.to_string());
            status
        }
        Err(_) => {
            log.say(Status::Fatal, BROKEN);
            Status::Fatal
        }
    }
}

/// A text of the importer.
///
/// # Safety
/// It ends with a zero byte, or is null.
unsafe fn text(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // Safety: the caller's.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}
