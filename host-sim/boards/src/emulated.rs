//! The firmware's image on an emulated RP2040: `rp2040js` in a process of Node.js, one exchange per
//! millisecond of its time.
//!
//! Only the firmware's pins and protocol are used here: samples go to the ADC, the valves get the duties in the PWM's
//! registers, and telemetry is read from the UART or from USB. At 921600 baud a frame takes most of a millisecond: the
//! telemetry of a step arrives with the next step.

use super::armed::if_armed;
use super::image;
use super::link::Link;
use model_core::control::Mode;
use model_core::joint::{JointSample, JointTelemetry, encoder};
use model_core::step_counts::StepCounts;
use model_core::{AdcCode, Config, RawCode, Sample, SetPoint, Telemetry};
use std::io::{BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use thermyo_plant::Actuation;
use thermyo_protocol::{Answer, BAUD, HostCommand, LastReset, PROTOCOL, Timing, Version};
use thermyo_simulation::board::{Board, BoardError, BoardStep};

/// One exchange, a step of the board \[ns\].
pub const STEP_NS: u32 = 1_000_000;
/// Exchanges after power-up, and after a restart, until the firmware has copied itself into RAM and listens. It copies
/// at the 6.5 MHz that are typical of the ring oscillator: 364 ms for the image of a muscle, 441 ms for that of a joint.
pub const START_MS: u32 = 480;
/// End of the first exchange: a tenth of a step before the next step, because inputs change between two steps.
const START_NS: u32 = START_MS * STEP_NS - STEP_NS / 10;
/// Exchanges after which an unanswered request fails.
const PATIENCE: u32 = 200;
/// Steps between two keep-alive messages of an idle host.
const ALIVE_STEPS: u32 = 100;
/// Bytes per millisecond that the UART carries.
const BYTES_PER_MS: u64 = BAUD as u64 / 10_000;
/// Largest number of bytes handed to the USB host at once; it sends them as fast as the board accepts them.
const USB_BYTES: usize = 4096;

/// Healthy inputs, used until others are set.
const IDLE: Sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));

/// Faults of the board that tests inject.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Injection {
    /// The converter stops or resumes its conversions.
    AdcStalled(bool),
    /// An instruction becomes an endless loop, once.
    Hang {
        place: Place,
        /// Number of the instruction, counting those executed there from now on: 1 is the next.
        instruction: u32,
    },
    /// An immediate fault of the processor.
    Fault,
    /// An immediate overflow of the stack.
    StackOverflow,
    /// Sets or clears a fault of a digital sensor.
    Part(PartFault),
    /// Power fails once during an operation of the flash, and returns at once.
    PowerCut {
        /// Number of the operation, counting those that begin from now on, each an erased sector or a programmed page:
        /// 1 is the next; `u32::MAX` means at once, whatever the flash does.
        operation: u32,
        /// Fraction of the operation's time that has passed.
        done: f32,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PartFault {
    #[default]
    None,
    /// The wires of the MAX31865 are off.
    GasUnplugged,
    /// The MAX31865 stops converting: its DRDY stays high.
    GasSilent,
    /// The wires of the MPR are off.
    PressureUnplugged,
    /// The MPR stays busy.
    PressureSilent,
    /// The wires of a joint's AS5600 are off.
    AngleUnplugged,
    /// DRDY of the MAX31865 stays low.
    GasReadyStuck,
    /// A message of the AS5600 was interrupted, now or before the board started: the chip holds SDA low until it has
    /// sent its byte.
    AngleInterrupted,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The control task and its executor.
    Control,
    /// The tasks of the thread executor.
    Thread,
    /// The other interrupts.
    Interrupts,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Port {
    Uart,
    /// The chip's own USB.
    Usb,
}

/// Bytes on one link.
#[derive(Debug, Default)]
struct Wire {
    link: Link,
    to_board: Vec<u8>,
    from_board: Vec<u8>,
}

impl Wire {
    fn feed(&mut self, bytes: &[u8]) {
        self.link.feed(bytes);
        self.from_board.extend_from_slice(bytes);
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Exchange {
    /// Fraction of the time in which the inlet's coil was powered.
    pub inlet_coil: f64,
    /// Fraction of the time in which the outlet's coil was powered.
    pub outlet_coil: f64,
    /// Duty set for the inlet's coil.
    pub inlet_duty: f64,
    /// Duty set for the outlet's coil.
    pub outlet_duty: f64,
    /// The same four values of a joint's muscle b.
    pub b: [f64; 4],
    /// Cycles in which the core did not sleep.
    pub busy_cycles: u32,
    /// Reads of flash, instructions included.
    pub flash_reads: u32,
    /// Reads that missed the flash cache and waited.
    pub flash_misses: u32,
    /// Restarts by the watchdog since power first came.
    pub restarts: u32,
    /// Times that power returned.
    pub power_cuts: u32,
    /// Operations of the flash since power first came: sectors erased and pages programmed.
    pub flash_operations: u32,
    /// Reads of flash while it was written, which return nothing on silicon, and operations with a
    /// wrong argument. Must be 0.
    pub flash_violations: u32,
    /// Bytes of the stack that have not been used since the last start.
    pub stack_unused: u32,
    pub fault_output: bool,
    pub led: bool,
    /// Whether an injected hang has not happened yet.
    pub hang_to_come: bool,
    pub boot_loader: bool,
    /// Whether the brake of a joint has power.
    pub brake_released: bool,
}

impl Exchange {
    /// Actual openings: the inlet opens with power, the outlet closes with it.
    pub fn actuation(&self) -> Actuation {
        Actuation { inlet: self.inlet_coil, outlet: 1.0 - self.outlet_coil }
    }

    /// Actual openings of a joint's muscles.
    pub fn actuations(&self) -> [Actuation; 2] {
        let [inlet, outlet, ..] = self.b;
        [self.actuation(), Actuation { inlet, outlet: 1.0 - outlet }]
    }

    /// Set openings of a joint's muscles.
    pub fn set_duties(&self) -> [Actuation; 2] {
        let [_, _, inlet, outlet] = self.b;
        [self.set_duty(), Actuation { inlet, outlet: 1.0 - outlet }]
    }

    /// Set openings: the duties from which the plant makes its own pulses.
    pub fn set_duty(&self) -> Actuation {
        Actuation { inlet: self.inlet_duty, outlet: 1.0 - self.outlet_duty }
    }
}

/// Reading that represents an encoder without its magnet.
const NO_MAGNET: u16 = u16::MAX;

/// Inputs of the board's pins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Sums of eight conversions of ADC0 to ADC2.
    adc: [u16; 3],
    /// Codes of the digital sensors: pressure, gas, gas of a joint's muscle b; reading of its encoder.
    parts: [u16; 4],
    emergency_stop: bool,
    heard: bool,
}

impl From<&Sample> for Inputs {
    fn from(sample: &Sample) -> Self {
        let Sample { pressure, gas, length, emergency_stop, heard, .. } = *sample;
        let [pressure, gas] = [pressure, gas].map(RawCode::to_bits);
        let adc = [pressure, gas, RawCode::from(length).to_bits()];
        Self { adc, parts: [pressure, gas, 0, NO_MAGNET], emergency_stop, heard }
    }
}

impl From<&JointSample> for Inputs {
    fn from(sample: &JointSample) -> Self {
        let JointSample { pressure, gas, angle: code, emergency_stop, heard, .. } = *sample;
        let [pressure_a, pressure_b] = pressure.map(RawCode::to_bits);
        let [gas_a, gas_b] = gas.map(RawCode::to_bits);
        let adc = [pressure_a, pressure_b, RawCode::from(code).to_bits()];
        let encoder = encoder::reading(code).unwrap_or(NO_MAGNET);
        Self { adc, parts: [0, gas_a, gas_b, encoder], emergency_stop, heard }
    }
}

pub struct EmulatedBoard {
    process: Child,
    requests: ChildStdin,
    responses: BufReader<ChildStdout>,
    wires: [Wire; 2],
    port: Port,
    plugged: bool,
    enumerated: bool,
    open: bool,
    deaf: bool,
    identities: Vec<String>,
    log: Vec<u8>,
    inputs: Inputs,
    adc_stalled: bool,
    part_fault: PartFault,
    hang: Option<(Place, u32)>,
    fault: bool,
    stack_overflow: bool,
    power_cut: Option<(u32, f32)>,
    restarts: u32,
    power_cuts: u32,
    /// Exchanges until a restarted board listens.
    starting: u32,
    /// Whether a restart was requested since the last start.
    restarted: bool,
    shown: Option<Exchange>,
    /// Steps since the start in which the core is in its startup check.
    startup_steps: u16,
    started: Exchange,
    /// Steps since the last keep-alive message.
    quiet_steps: u32,
}

impl EmulatedBoard {
    /// Starts a board with the firmware of this program or its checkout.
    pub fn new() -> Result<Self, BoardError> {
        let scripts = image::prepare_emulator()?;
        Self::start_up(&scripts, &image::firmware(image::Variant::Standard)?, None)
    }

    /// Starts a board with an image, whose flash content is kept in a file; a missing file is created. The emulator's
    /// scripts must be prepared.
    pub fn with_flash(scripts: &Path, image: &Path, file: &Path) -> Result<Self, BoardError> {
        Self::start_up(scripts, image, Some(file))
    }

    /// Starts a board with an image, ELF or UF2, which has just been powered up.
    pub fn with_image(path: &Path) -> Result<Self, BoardError> {
        Self::start_up(&image::prepare_emulator()?, path, None)
    }

    pub(super) fn start_up(
        scripts: &Path,
        path: &Path,
        flash: Option<&Path>,
    ) -> Result<Self, BoardError> {
        if !path.is_file() {
            return Err(BoardError::NoImage { path: path.to_path_buf() });
        }
        let mut process = Command::new("node")
            .arg(scripts.join("emulator.mjs"))
            .arg(path)
            .args(flash)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|_| BoardError::NoNode)?;
        let (Some(requests), Some(responses)) = (process.stdin.take(), process.stdout.take())
        else {
            return Err(BoardError::NoNode);
        };
        let mut board = Self {
            process,
            requests,
            responses: BufReader::new(responses),
            wires: [Wire::default(), Wire::default()],
            port: Port::Uart,
            plugged: false,
            enumerated: false,
            open: false,
            deaf: false,
            identities: Vec::new(),
            log: Vec::new(),
            inputs: Inputs::from(&IDLE),
            adc_stalled: false,
            part_fault: PartFault::None,
            hang: None,
            fault: false,
            stack_overflow: false,
            power_cut: None,
            restarts: 0,
            power_cuts: 0,
            starting: 0,
            restarted: false,
            shown: None,
            startup_steps: 0,
            started: Exchange::default(),
            quiet_steps: 0,
        };
        board.response().map_err(|error| match error {
            BoardError::Emulator { message } => BoardError::Image { message },
            other => other,
        })?;
        board.started = board.run(&IDLE, START_NS)?;
        Ok(board)
    }

    /// Runs one millisecond with these inputs. Sends keep-alive messages if the sample allows the host to be heard.
    pub fn exchange(&mut self, inputs: impl Into<Inputs>) -> Result<Exchange, BoardError> {
        let inputs = inputs.into();
        self.keep_alive(inputs.heard);
        self.run(inputs, STEP_NS)
    }

    /// Sends a keep-alive message in one of [`ALIVE_STEPS`] calls, as long as the host can be heard.
    pub(super) fn keep_alive(&mut self, heard: bool) {
        self.quiet_steps = if heard { self.quiet_steps + 1 } else { 0 };
        if self.quiet_steps >= ALIVE_STEPS {
            self.quiet_steps = 0;
            self.send(HostCommand::Alive);
        }
    }

    /// The exchange from power-up until the board listened.
    pub fn started(&self) -> Exchange {
        self.started
    }

    /// The last exchange; `None` before the first.
    pub fn shown(&self) -> Option<Exchange> {
        self.shown
    }

    /// Selects the link to use from now on. The other one keeps running: its bytes are kept.
    pub fn use_port(&mut self, port: Port) {
        self.port = port;
    }

    /// Plugs or unplugs the USB cable at the next exchange.
    pub fn plug(&mut self, plugged: bool) {
        self.plugged = plugged;
        self.enumerated &= plugged;
    }

    /// Opens or closes the USB port at the next exchange.
    pub fn open(&mut self, open: bool) {
        self.open = open;
    }

    /// Stops or resumes reading by the program at the USB port, at the next exchange.
    pub fn stop_reading(&mut self, deaf: bool) {
        self.deaf = deaf;
    }

    /// Plugs USB in, opens its port and uses it, as soon as the board answers.
    pub fn connect_usb(&mut self) -> Result<(), BoardError> {
        let inputs = self.inputs;
        self.connect_usb_while(&mut |board| board.exchange(inputs))
    }

    /// As [`Self::connect_usb`], while `run` runs the milliseconds until then.
    pub fn connect_usb_while(
        &mut self,
        run: &mut dyn FnMut(&mut Self) -> Result<Exchange, BoardError>,
    ) -> Result<(), BoardError> {
        self.plug(true);
        self.open(true);
        self.use_port(Port::Usb);
        for _ in 0..PATIENCE {
            run(self)?;
            if self.enumerated {
                return Ok(());
            }
        }
        Err(BoardError::Silent { asked: "USB" })
    }

    /// USB identities since the last call, one for each time the cable was plugged in: vendor,
    /// product, their names, serial number.
    pub fn take_identities(&mut self) -> Vec<String> {
        std::mem::take(&mut self.identities)
    }

    fn wire(&mut self) -> &mut Wire {
        &mut self.wires[self.port as usize]
    }

    /// Sends raw bytes to the board.
    pub fn write(&mut self, bytes: &[u8]) {
        self.wire().to_board.extend_from_slice(bytes);
    }

    /// Number of bytes that wait for the link to the board.
    pub fn waiting(&self) -> usize {
        self.wires[self.port as usize].to_board.len()
    }

    /// Drops the waiting bytes.
    pub fn discard(&mut self) {
        self.wire().to_board.clear();
    }

    /// Sends a request without waiting for its answer.
    pub fn send(&mut self, command: HostCommand) {
        self.request(command);
    }

    /// Sends a request, whose answer is [taken](Self::take_answer) later; returns its number.
    pub fn request(&mut self, command: HostCommand) -> u8 {
        let (sequence, frame) = self.wire().link.request(command);
        self.write(&frame);
        sequence
    }

    /// The answer to the request with this number, if it has arrived.
    pub fn take_answer(&mut self, sequence: u8) -> Option<Answer> {
        self.wire().link.take_answer(sequence)
    }

    /// Raw bytes from the board since the last call.
    pub fn read(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.wire().from_board)
    }

    /// Telemetry since the last call, or since the last step.
    pub fn take_telemetry(&mut self) -> Vec<Telemetry> {
        let link = &mut self.wire().link;
        std::iter::from_fn(|| link.take_telemetry()).collect()
    }

    /// Telemetry of a joint since the last call, or since the last step.
    pub fn take_joint_telemetry(&mut self) -> Vec<JointTelemetry> {
        let link = &mut self.wire().link;
        std::iter::from_fn(|| link.take_joint_telemetry()).collect()
    }

    pub fn inject(&mut self, injection: Injection) {
        match injection {
            Injection::AdcStalled(stalled) => self.adc_stalled = stalled,
            Injection::Part(fault) => self.part_fault = fault,
            Injection::Hang { place, instruction } => self.hang = Some((place, instruction)),
            Injection::Fault => self.fault = true,
            Injection::StackOverflow => self.stack_overflow = true,
            Injection::PowerCut { operation, done } => self.power_cut = Some((operation, done)),
        }
    }

    /// Log of the firmware since the last call: frames of defmt.
    pub fn take_log(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.log)
    }

    /// Waits for a board that has just restarted, sends it a request and runs until its answer arrives; the inputs do
    /// not change.
    pub fn ask(&mut self, command: HostCommand) -> Result<Answer, BoardError> {
        let inputs = self.inputs;
        while self.starting > 0 {
            self.exchange(inputs)?;
        }
        let sequence = self.request(command);
        for _ in 0..PATIENCE {
            self.exchange(inputs)?;
            match self.take_answer(sequence) {
                Some(Answer::Refused(refusal)) => return Err(BoardError::Refused(refusal)),
                Some(answer) => return Ok(answer),
                None => (),
            }
        }
        Err(BoardError::Silent { asked: "a request" })
    }

    pub fn version(&mut self) -> Result<Version, BoardError> {
        match self.ask(HostCommand::Version)? {
            Answer::Version(version) => Ok(version),
            _ => Err(BoardError::Silent { asked: "version" }),
        }
    }

    pub fn timing(&mut self) -> Result<Timing, BoardError> {
        match self.ask(HostCommand::Timing)? {
            Answer::Timing(timing) => Ok(timing),
            _ => Err(BoardError::Silent { asked: "timing" }),
        }
    }

    pub fn last_reset(&mut self) -> Result<LastReset, BoardError> {
        match self.ask(HostCommand::LastReset)? {
            Answer::LastReset(last_reset) => Ok(last_reset),
            _ => Err(BoardError::Silent { asked: "reason of the last restart" }),
        }
    }

    /// As [`EmulatedBoard::exchange`], for any time and without keep-alive messages.
    pub fn run(
        &mut self,
        inputs: impl Into<Inputs>,
        nanoseconds: u32,
    ) -> Result<Exchange, BoardError> {
        let inputs = inputs.into();
        self.inputs = inputs;
        let carried = u64::from(nanoseconds) * BYTES_PER_MS / u64::from(STEP_NS);
        let [uart, usb] = &mut self.wires;
        let uart = drain(&mut uart.to_board, carried as usize);
        let usb = drain(&mut usb.to_board, USB_BYTES);
        let mut request = Vec::with_capacity(32 + uart.len() + usb.len());
        request.extend_from_slice(&nanoseconds.to_le_bytes());
        for code in inputs.adc.into_iter().chain(inputs.parts) {
            request.extend_from_slice(&code.to_le_bytes());
        }
        let fault = core::mem::take(&mut self.fault);
        request.push(
            u8::from(!inputs.emergency_stop)
                | u8::from(self.adc_stalled) << 1
                | u8::from(fault) << 2
                | u8::from(self.plugged) << 3
                | u8::from(self.open) << 4
                | (self.part_fault as u8) << 5,
        );
        let (place, instruction) = self.hang.take().unwrap_or((Place::Control, 0));
        request.push(place as u8);
        request.extend_from_slice(&instruction.to_le_bytes());
        let (operation, done) = self.power_cut.take().unwrap_or_default();
        request.extend_from_slice(&operation.to_le_bytes());
        request.extend_from_slice(&((done * 65_535.0) as u16).to_le_bytes());
        for bytes in [&uart, &usb] {
            request.extend_from_slice(&(bytes.len() as u16).to_le_bytes());
        }
        let overflows = core::mem::take(&mut self.stack_overflow);
        request.push(u8::from(self.deaf) | u8::from(overflows) << 1);
        request.extend(uart);
        request.extend(usb);
        if self.requests.write_all(&request).and_then(|()| self.requests.flush()).is_err() {
            return Err(self.ended());
        }
        let mut exchange = self.response()?;
        let share = |powered_ns: f64| (powered_ns / f64::from(nanoseconds)).min(1.0);
        exchange.inlet_coil = share(exchange.inlet_coil);
        exchange.outlet_coil = share(exchange.outlet_coil);
        let [inlet, outlet, inlet_duty, outlet_duty] = exchange.b;
        exchange.b = [share(inlet), share(outlet), inlet_duty, outlet_duty];
        let ends = (exchange.restarts, exchange.power_cuts);
        let goes_on = ends == (self.restarts, self.power_cuts);
        self.starting = if goes_on { self.starting.saturating_sub(1) } else { START_MS };
        (self.restarts, self.power_cuts) = ends;
        Ok(exchange)
    }

    /// Reads a response, in which the coils' fractions are still nanoseconds.
    fn response(&mut self) -> Result<Exchange, BoardError> {
        match self.read_response() {
            Ok(exchange) => Ok(exchange),
            Err(_) => Err(self.ended()),
        }
    }

    fn read_response(&mut self) -> std::io::Result<Exchange> {
        let mut word = || {
            let mut bytes = [0; 4];
            self.responses.read_exact(&mut bytes).map(|()| u32::from_le_bytes(bytes))
        };
        let [inlet_ns, outlet_ns, inlet_b_ns, outlet_b_ns] = [word()?, word()?, word()?, word()?];
        let busy_cycles = word()?;
        let [restarts, flash_reads, flash_misses] = [word()?, word()?, word()?];
        let [power_cuts, flash_operations, flash_violations] = [word()?, word()?, word()?];
        let stack_unused = word()?;
        let mut half_word = || {
            let mut bytes = [0; 2];
            self.responses.read_exact(&mut bytes).map(|()| f64::from(u16::from_le_bytes(bytes)))
        };
        let mut duty = || half_word().map(|duty| duty / 65_535.0);
        let [inlet_duty, outlet_duty, inlet_b_duty, outlet_b_duty] =
            [duty()?, duty()?, duty()?, duty()?];
        let mut state = [0];
        self.responses.read_exact(&mut state)?;
        for port in [Port::Uart, Port::Usb] {
            let bytes = self.read_counted()?;
            self.wires[port as usize].feed(&bytes);
        }
        let identities = self.read_counted()?;
        self.enumerated |= !identities.is_empty();
        self.identities.extend(String::from_utf8_lossy(&identities).lines().map(str::to_owned));
        let log = self.read_counted()?;
        self.log.extend(log);
        let [state] = state;
        Ok(Exchange {
            inlet_coil: f64::from(inlet_ns),
            outlet_coil: f64::from(outlet_ns),
            inlet_duty,
            outlet_duty,
            b: [f64::from(inlet_b_ns), f64::from(outlet_b_ns), inlet_b_duty, outlet_b_duty],
            busy_cycles,
            flash_reads,
            flash_misses,
            restarts,
            power_cuts,
            flash_operations,
            flash_violations,
            stack_unused,
            fault_output: state & 1 != 0,
            led: state & 2 != 0,
            hang_to_come: state & 4 != 0,
            boot_loader: state & 8 != 0,
            brake_released: state & 16 != 0,
        })
    }

    fn read_counted(&mut self) -> std::io::Result<Vec<u8>> {
        let mut count = [0; 2];
        self.responses.read_exact(&mut count)?;
        let mut bytes = vec![0; usize::from(u16::from_le_bytes(count))];
        self.responses.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn ended(&mut self) -> BoardError {
        let mut message = String::new();
        if let Some(mut errors) = self.process.stderr.take() {
            // The process has ended: this does not block.
            let _ = errors.read_to_string(&mut message);
        }
        BoardError::Emulator { message: message.trim().to_owned() }
    }
}

/// Takes up to `most` bytes from the front.
fn drain(bytes: &mut Vec<u8>, most: usize) -> Vec<u8> {
    bytes.drain(..bytes.len().min(most)).collect()
}

impl Board for EmulatedBoard {
    fn name(&self) -> &'static str {
        "emulated"
    }

    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError> {
        let version = self.version()?;
        if version.protocol != PROTOCOL {
            return Err(BoardError::Protocol { board: version.protocol });
        }
        self.ask(HostCommand::TelemetryDivider(1))?;
        self.ask(HostCommand::Configure(*config))?;
        let armed = self.ask(HostCommand::Arm { most_pa: None });
        let set_point = if_armed(armed, set_point)?;
        self.wire().from_board.clear();
        // The request takes a fraction of the exchange to arrive: the next step is the first of the
        // startup check.
        self.send(HostCommand::Start(set_point));
        let inputs = self.inputs;
        self.exchange(inputs)?;
        self.startup_steps = StepCounts::new(config.step_s).startup_steps;
        self.restarted = false;
        Ok(())
    }

    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.send(HostCommand::Set(set_point));
        Ok(())
    }

    fn step(&mut self, sample: &Sample) -> Result<BoardStep, BoardError> {
        let wanted = self.restarts + u32::from(self.fault);
        for _ in 1..std::mem::take(&mut self.startup_steps) {
            self.exchange(sample)?;
        }
        let exchange = self.exchange(sample)?;
        self.shown = Some(exchange);
        self.wire().from_board.clear();
        if exchange.restarts != wanted {
            return Err(BoardError::Restarted);
        }
        let restarted = self.restarted;
        let link = &mut self.wire().link;
        let mut telemetry = std::iter::from_fn(|| link.take_telemetry());
        let telemetry = telemetry.find(|seen| restarted || seen.mode != Mode::StartupCheck);
        Ok(BoardStep { telemetry, actuation: exchange.set_duty() })
    }

    fn restart(&mut self) -> Result<(), BoardError> {
        self.inject(Injection::Fault);
        self.restarted = true;
        Ok(())
    }

    fn timing(&mut self) -> Result<Option<Timing>, BoardError> {
        // Calls the inherent method, not this one.
        Self::timing(self).map(Some)
    }
}

impl Drop for EmulatedBoard {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
