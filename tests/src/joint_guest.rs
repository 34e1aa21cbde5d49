//! The core of a joint on an emulated RP2040 (`tests/joint_guest`).

use crate::guest;
use model_core::joint::{JointConfig, JointSample, JointSetPoint, JointTelemetry};
use object::{Object, ObjectSegment, ObjectSymbol};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{BufReader, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use thermyo_boards::image::prepare_emulator;

const TARGET: &str = "thumbv6m-none-eabi";

/// Size of the guest's buffer \[bytes\].
const BUFFER_BYTES: usize = 2048;

pub struct EmulatedJoint {
    process: Child,
    requests: ChildStdin,
    responses: BufReader<ChildStdout>,
    symbols: BTreeMap<String, (u32, u64)>,
    /// Memory that a joint takes \[bytes\].
    pub joint_bytes: u64,
}

impl EmulatedJoint {
    /// Builds and loads the guest.
    pub fn load() -> Self {
        let image = guest("joint-guest", TARGET, "joint-guest");
        let file = object::File::parse(&*image).expect("an ELF file");
        let scripts = prepare_emulator().expect("the emulator is there");
        let mut process = Command::new("node")
            .arg(scripts.join("guest.mjs"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("Node.js starts");
        let requests = process.stdin.take().expect("it is piped");
        let responses = BufReader::new(process.stdout.take().expect("it is piped"));
        let mut symbols = BTreeMap::new();
        for symbol in file.symbols() {
            let name = symbol.name().expect("the file is whole").to_owned();
            symbols.insert(name, (symbol.address() as u32, symbol.size()));
        }
        let (_, joint_bytes) = symbols["JOINT"];
        let mut guest = Self { process, requests, responses, symbols, joint_bytes };
        for segment in file.segments() {
            let content = segment.data().expect("the file is whole");
            guest.request(0, segment.address() as u32, content, 0);
        }
        guest
    }

    /// Writes bytes, calls a function, and reads bytes at the same place: returns its result, its cycles, and the
    /// bytes.
    fn request(
        &mut self,
        function: u32,
        place: u32,
        bytes: &[u8],
        reads: usize,
    ) -> (u32, u32, Vec<u8>) {
        let header = [function, place, bytes.len() as u32, reads as u32];
        let mut request: Vec<u8> = header.into_iter().flat_map(u32::to_le_bytes).collect();
        request.extend_from_slice(bytes);
        let sent = self.requests.write_all(&request).and_then(|()| self.requests.flush());
        sent.expect("the emulator listens");
        let mut word = || {
            let mut bytes = [0; 4];
            self.responses.read_exact(&mut bytes).expect("the function returns");
            u32::from_le_bytes(bytes)
        };
        let (result, cycles) = (word(), word());
        let mut bytes = vec![0; reads];
        self.responses.read_exact(&mut bytes).expect("the emulator goes on");
        (result, cycles, bytes)
    }

    fn call(&mut self, name: &str, argument: &[u8], reads: usize) -> (u32, u32, Vec<u8>) {
        let ((function, _), (buffer, _)) = (self.symbols[name], self.symbols["BUFFER"]);
        self.request(function, buffer, argument, reads)
    }

    /// Restarts with a configuration.
    pub fn configure(&mut self, config: &JointConfig) {
        self.call("configure", &encoded(config), 0);
    }

    /// Takes a set point, unless the joint refuses it.
    pub fn set(&mut self, set_point: JointSetPoint) {
        self.call("set", &encoded(&set_point), 0);
    }

    /// Runs one step; returns its telemetry, encoded, and the cycles of the core.
    pub fn step(&mut self, sample: &JointSample) -> (Vec<u8>, u32) {
        self.call("sample", &encoded(sample), 0);
        let (_, cycles, _) = self.call("step", &[], 0);
        let (length, _, mut telemetry) = self.call("telemetry", &[], BUFFER_BYTES);
        telemetry.truncate(length as usize);
        (telemetry, cycles)
    }
}

impl Drop for EmulatedJoint {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Encodes as postcard, which keeps every bit.
pub fn encoded<T: Serialize>(value: &T) -> Vec<u8> {
    let mut bytes = [0; BUFFER_BYTES];
    postcard::to_slice(value, &mut bytes).expect("it fits the buffer").to_vec()
}

/// Reads the telemetry of a step.
pub fn decoded(telemetry: &[u8]) -> JointTelemetry {
    postcard::from_bytes(telemetry).expect("the guest writes telemetry")
}
