//! The C interface of FMI 3.0 co-simulation around [`thermyo_cosimulation::model::Model`].
//!
//! Names and signatures are those of `fmi3FunctionTypes.h`. Each error is logged once, in one
//! line, by the importer's callback; a panic does not leave the library.

#![allow(non_snake_case)]

mod instance;
mod unsupported;

use instance::{Instance, LogMessage, Status, guarded};
use std::ffi::{c_char, c_void};
use thermyo_cosimulation::model::ModelError;

/// The version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Errors are always logged, and there are no other messages.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetDebugLogging(
    _instance: *mut Instance,
    _logging_on: bool,
    _count: usize,
    _categories: *const *const c_char,
) -> Status {
    Status::Ok
}

/// Creates an instance from the unit's resources; null, and a message, if that fails.
///
/// # Safety
/// As in the standard: texts end with a zero byte, or are null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    _instance_name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging_on: bool,
    _event_mode_used: bool,
    _early_return_allowed: bool,
    _required: *const u32,
    _required_count: usize,
    environment: *mut c_void,
    log: Option<LogMessage>,
    _intermediate_update: *const c_void,
) -> *mut Instance {
    // Safety: the caller's.
    unsafe { Instance::make(token, resources, environment, log) }
}

/// Frees an instance.
///
/// # Safety
/// The instance is one of this library, or null, and is not used afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(instance: *mut Instance) {
    if !instance.is_null() {
        // Safety: it came from a box, and the caller owns it.
        drop(unsafe { Box::from_raw(instance) });
    }
}

/// Sets start and stop time. The tolerance has no effect.
///
/// # Safety
/// The instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterInitializationMode(
    instance: *mut Instance,
    _tolerance_defined: bool,
    _tolerance: f64,
    start_s: f64,
    stop_time_defined: bool,
    stop_s: f64,
) -> Status {
    // Safety: the caller's.
    unsafe {
        guarded(instance, |model| model.begin_at(start_s, stop_time_defined.then_some(stop_s)))
    }
}

/// Starts stepping.
///
/// # Safety
/// The instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3ExitInitializationMode(instance: *mut Instance) -> Status {
    // Safety: the caller's.
    unsafe { guarded(instance, thermyo_cosimulation::model::Model::start) }
}

/// Ends the simulation; the last values can still be read.
///
/// # Safety
/// The instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Terminate(instance: *mut Instance) -> Status {
    // Safety: the caller's.
    unsafe {
        guarded(instance, |model| {
            model.terminate();
            Ok(())
        })
    }
}

/// Resets the instance.
///
/// # Safety
/// The instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Reset(instance: *mut Instance) -> Status {
    // Safety: the caller's.
    unsafe { guarded(instance, thermyo_cosimulation::model::Model::reset) }
}

/// # Safety
/// The instance is one of this library, and both arrays have the given lengths.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFloat64(
    instance: *mut Instance,
    references: *const u32,
    count: usize,
    values: *mut f64,
    value_count: usize,
) -> Status {
    // Safety: the caller's.
    unsafe {
        guarded(instance, |model| {
            get((references, count), (values, value_count), |reference| model.number(reference))
        })
    }
}

/// # Safety
/// As [`fmi3GetFloat64`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFloat64(
    instance: *mut Instance,
    references: *const u32,
    count: usize,
    values: *const f64,
    value_count: usize,
) -> Status {
    // Safety: the caller's.
    unsafe {
        guarded(instance, |model| {
            let give = |reference, value| model.set_number(reference, value);
            set((references, count), (values, value_count), give)
        })
    }
}

/// # Safety
/// As [`fmi3GetFloat64`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetBoolean(
    instance: *mut Instance,
    references: *const u32,
    count: usize,
    values: *mut bool,
    value_count: usize,
) -> Status {
    // Safety: the caller's.
    unsafe {
        guarded(instance, |model| {
            get((references, count), (values, value_count), |reference| model.switch(reference))
        })
    }
}

/// # Safety
/// As [`fmi3GetFloat64`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetBoolean(
    instance: *mut Instance,
    references: *const u32,
    count: usize,
    values: *const bool,
    value_count: usize,
) -> Status {
    // Safety: the caller's.
    unsafe {
        guarded(instance, |model| {
            let give = |reference, value| model.set_switch(reference, value);
            set((references, count), (values, value_count), give)
        })
    }
}

/// Advances by a whole number of the scenario's steps. Another length is discarded without effect.
///
/// # Safety
/// The instance is one of this library; the output pointers can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DoStep(
    instance: *mut Instance,
    from_s: f64,
    length_s: f64,
    _no_state_before: bool,
    event_handling_needed: *mut bool,
    terminate: *mut bool,
    early_return: *mut bool,
    last_successful_s: *mut f64,
) -> Status {
    // Safety: the caller's.
    unsafe {
        guarded(instance, |model| {
            let done = model.step(from_s, length_s);
            for flag in [event_handling_needed, terminate, early_return] {
                tell(flag, false);
            }
            tell(last_successful_s, model.time_s());
            done
        })
    }
}

/// Writes an optional output.
///
/// # Safety
/// The pointer is null, or can be written.
unsafe fn tell<T>(place: *mut T, value: T) {
    if !place.is_null() {
        // Safety: the caller's.
        unsafe { place.write(value) };
    }
}

/// Pairs references with as many values, since every variable is a scalar.
///
/// # Safety
/// The arrays have the given lengths.
unsafe fn pairs<'a, V>(
    (references, count): (*const u32, usize),
    (values, value_count): (V, usize),
) -> Result<(&'a [u32], V), ModelError> {
    if count != value_count {
        let reference = u32::MAX;
        return Err(ModelError::Reference {
            reference,
            what: "array: as many values as references",
        });
    }
    if count == 0 {
        return Ok((&[], values));
    }
    // Safety: the caller's; no reference is kept.
    Ok((unsafe { std::slice::from_raw_parts(references, count) }, values))
}

unsafe fn get<T>(
    references: (*const u32, usize),
    values: (*mut T, usize),
    of: impl Fn(u32) -> Result<T, ModelError>,
) -> Result<(), ModelError> {
    // Safety: the caller's.
    let (references, values) = unsafe { pairs(references, values)? };
    for (i, reference) in references.iter().enumerate() {
        let value = of(*reference)?;
        // Safety: as many as references.
        unsafe { values.add(i).write(value) };
    }
    Ok(())
}

unsafe fn set<T: Copy>(
    references: (*const u32, usize),
    values: (*const T, usize),
    mut give: impl FnMut(u32, T) -> Result<(), ModelError>,
) -> Result<(), ModelError> {
    // Safety: the caller's.
    let (references, values) = unsafe { pairs(references, values)? };
    for (i, reference) in references.iter().enumerate() {
        // Safety: as many as references.
        give(*reference, unsafe { values.add(i).read() })?;
    }
    Ok(())
}
