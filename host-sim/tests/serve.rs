//! `thermyo serve` over its websocket, as pages use it, on the emulated board; and in headless
//! Chromium.

use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use crate::board_support::Bench;
use crate::command_support::Said;

/// Serialises the tests: an emulated board needs a core for itself.
static ONE_BY_ONE: Mutex<()> = Mutex::new(());

/// Longest wait of a test \[s\], even on a busy machine: a limit against hanging, not a target.
const HANGS_S: f64 = 180.0;

/// A server, which is stopped with its board.
pub(crate) struct Served {
    pub(crate) bench: Bench,
    pub(crate) child: Child,
    pub(crate) url: String,
    _turn: MutexGuard<'static, ()>,
}

impl Served {
    /// Starts a server. `what` is its argument; recordings go to `out/serve` in the test's folder.
    pub(crate) fn new(what: &str) -> Self {
        Self::after("", what)
    }

    /// As [`Self::new`], from a shell that runs `before` first.
    fn after(before: &str, what: &str) -> Self {
        Self::plugged("", before, what)
    }

    /// As above, with a scenario's muscle or joint at the board's pins.
    pub(crate) fn plugged(scenario: &str, before: &str, what: &str) -> Self {
        let turn = ONE_BY_ONE.lock().unwrap_or_else(PoisonError::into_inner);
        let bench = Bench::new();
        let serve = bench.command(&format!("thermyo serve {what} --out out/serve"));
        // The board's start takes longer than the time left for the server.
        bench.ok(&format!("thermyo board emulated plug {scenario}"));
        let mut shell = Command::new("env");
        // Tests started by `nohup` would pass on their ignored SIGHUP.
        #[cfg(target_os = "linux")]
        shell.arg("--default-signal=HUP");
        shell.args(["sh", "-c", &format!("{before}\nexec \"$0\" \"$@\"")]);
        shell.arg(serve.get_program()).args(serve.get_args());
        shell.current_dir(serve.get_current_dir().unwrap());
        shell.envs(serve.get_envs().filter_map(|(name, value)| Some((name, value?))));
        let mut child = shell.stdout(Stdio::piped()).spawn().unwrap();
        let mut url = String::new();
        let mut lines = BufReader::new(child.stdout.take().unwrap());
        lines.read_line(&mut url).unwrap();
        let mut hint = String::new();
        lines.read_line(&mut hint).unwrap();
        child.stdout = Some(lines.into_inner());
        Self { bench, child, url: url.trim().to_owned(), _turn: turn }
    }

    pub(crate) fn host(&self) -> &str {
        self.url.trim_start_matches("http://").split('/').next().unwrap()
    }

    /// Status line and body of an address.
    pub(crate) fn get(&self, path: &str, host: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(self.host()).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        (text.split(' ').nth(1).unwrap().parse().unwrap(), text)
    }

    pub(crate) fn path(&self, file: &str) -> String {
        format!("/{}/{file}", self.url.split('/').nth(3).unwrap())
    }

    pub(crate) fn page(&self) -> Page {
        self.page_from(None).unwrap()
    }

    fn page_from(&self, origin: Option<&str>) -> Option<Page> {
        let address = format!("{}live", self.url.replace("http:", "ws:"));
        let mut request = address.into_client_request().unwrap();
        if let Some(origin) = origin {
            request.headers_mut().insert("origin", origin.parse().unwrap());
        }
        let stream = TcpStream::connect(self.host()).unwrap();
        // As browsers do.
        stream.set_nodelay(true).unwrap();
        let (socket, _) = tungstenite::client(request, stream).ok()?;
        socket.get_ref().set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        Some(Page { socket, received: 0, state: Value::Null, own: Value::Null, frame: Value::Null })
    }

    fn signal(&self, signal: &str) {
        let pid = self.child.id().to_string();
        assert!(Command::new("kill").args([signal, &pid]).status().unwrap().success());
    }

    /// Ends the server by a signal, which its exit code shows; returns its further output.
    pub(crate) fn end(&mut self, signal: &str) -> String {
        self.signal(signal);
        let mut text = String::new();
        self.child.stdout.take().unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(130), "{text}");
        text
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A page, and its last messages.
pub(crate) struct Page {
    socket: WebSocket<TcpStream>,
    received: u64,
    pub(crate) state: Value,
    pub(crate) own: Value,
    pub(crate) frame: Value,
}

impl Page {
    pub(crate) fn say(&mut self, word: Value) {
        self.socket.send(Message::text(word.to_string())).unwrap();
    }

    pub(crate) fn order(&mut self, order: Value) {
        self.say(json!({ "order": order }));
    }

    /// Takes one message, if there is one; acknowledges it, if the page is not slow.
    fn hear(&mut self, quick: bool) {
        let Ok(Message::Text(text)) = self.socket.read() else { return };
        self.received += 1;
        let message: Value = serde_json::from_str(&text).unwrap();
        match message["kind"].as_str() {
            Some("state") => self.state = message,
            Some("own") => self.own = message,
            _ => self.frame = message,
        }
        if quick {
            self.say(json!({ "seen": self.received }));
        }
    }

    /// Waits for a condition; returns the waiting time.
    pub(crate) fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) -> Duration {
        let start = Instant::now();
        // The page may have been behind.
        self.say(json!({ "seen": self.received }));
        while !done(self) {
            let events: Vec<&Value> =
                self.state["events"].as_array().into_iter().flatten().map(|e| &e["text"]).collect();
            assert!(start.elapsed().as_secs_f64() < HANGS_S, "{what}: {} {events:?}", self.frame);
            self.hear(true);
        }
        start.elapsed()
    }

    /// Waits until this page steers a board that is configured.
    pub(crate) fn configured(&mut self) {
        self.until("configured", |page| {
            page.own["steers"] == true && page.state["configuration"]["configured"] == true
        });
    }

    fn pressure_pa(&self) -> f64 {
        self.cell(1)
    }

    /// Cell of the last row.
    pub(crate) fn cell(&self, index: usize) -> f64 {
        let rows = self.frame["rows"].as_array();
        rows.and_then(|rows| rows.last()?[index].as_f64()).unwrap_or(f64::NAN)
    }

    pub(crate) fn happened(&self, what: &str) -> bool {
        let mut events = self.state["events"].as_array().into_iter().flatten();
        events.any(|event| event["text"].as_str().unwrap().contains(what))
    }

    /// Configures the muscle, arms, and holds a pressure.
    pub(crate) fn drive(&mut self, pressure_pa: f64) {
        self.until("a state", |page| page.state.is_object() && page.own["steers"] == true);
        if self.state["configuration"]["configured"] == false {
            self.order(json!({ "configure": null }));
        }
        self.until("configuration", |page| page.state["configuration"]["configured"] == true);
        self.order(json!({ "arm": { "most_pa": null } }));
        self.until("armed", |page| page.state["armed_pa"].is_number());
        self.order(json!({ "set": { "Pressure": { "pressure_pa": pressure_pa } } }));
        self.until("the pressure follows", |page| {
            let driven = page.frame["set_point"]["Pressure"]["pressure_pa"] == pressure_pa;
            driven && (page.pressure_pa() - pressure_pa).abs() < 2e3
        });
    }
}

#[test]
fn only_its_own_page_comes_in() {
    let served = Served::new("emulated");
    let host = served.host().to_owned();
    let (status, text) = served.get(&served.path(""), &host);
    assert_eq!(status, 200, "{text}");
    assert!(text.contains("content-security-policy: default-src 'none'"), "{text}");
    let scripts = ["page.js", "chart.js", "live.js", "muscle.js", "palette.js", "units.js"];
    let own = ["quantities.js", "of_muscle.js", "of_joint.js", "arm.js"];
    for file in scripts.into_iter().chain(own).chain(["page.css", "chart.css", "drawing.css"]) {
        assert_eq!(served.get(&served.path(file), &host).0, 200, "{file}");
    }
    for (path, host) in [
        ("/", host.as_str()),
        ("/00000000000000000000000000000000/", &host),
        (&served.path(""), "evil.example"),
    ] {
        assert_eq!(served.get(path, host).0, 403, "{path} {host}");
    }
    assert_eq!(served.get(&served.path("results/../page.js"), &host).0, 404);
    assert_eq!(served.get(&served.path("results/record-1/report.html"), &host).0, 404);
    assert!(served.page_from(Some("http://evil.example")).is_none());
    assert!(served.page_from(Some(&format!("http://{host}"))).is_some());
}

/// A scenario that names a file: its content must not reach a page.
fn assert_no_file_is_shown(served: &Served, page: &mut Page) {
    let file = served.bench.path("profile.csv");
    fs::write(&file, "a-line-of-the-file,7\n").unwrap();
    let text = format!("[drive]\nkind = \"pressure\"\nprofile_csv = \"{}\"\n", file.display());
    page.order(json!({ "configure": { "name": "sent.toml", "text": text } }));
    page.until("a file is refused", |page| {
        page.happened("sent.toml:") && page.happened("must be left out")
    });
    assert!(!page.happened("a-line-of-the-file"), "{}", page.state["events"]);
}

/// The earlier messages stay in the log, however many follow.
fn assert_a_flood_is_logged_once(second: &mut Page) {
    for i in 0..300 {
        second.say(json!({ "fire": i }));
        second.order(json!("save"));
    }
    second.say(json!("vent"));
    second.until("heard to its end", |page| page.happened("Vent was pressed on a page"));
    let times = |page: &Page, what: &str| {
        let events = page.state["events"].as_array().unwrap().iter();
        events.filter(|event| event["text"].as_str().unwrap().contains(what)).count()
    };
    assert_eq!(times(second, "not understood"), 2, "one of each page: {}", second.state["events"]);
    assert_eq!(times(second, "another page steers"), 1);
    assert!(second.happened("connected with"));
}

#[test]
fn a_page_steers_and_another_watches() {
    let mut served = Served::new("emulated");
    let mut first = served.page();
    first.until("a state", |page| page.state.is_object());
    first.order(json!({ "arm": { "most_pa": null } }));
    first.until("refused", |page| page.happened("the board does not know its muscle"));
    first.say(json!({ "fire": 1 }));
    first.until("garbage", |page| page.happened("not understood"));
    first.drive(1.3e5);
    first.order(json!({ "set": { "Pressure": { "pressure_pa": 9e6 } } }));
    first.until("out of range", |page| page.happened("must be from 101.33 kPa"));
    first.order(json!({ "set": { "Pressure": { "pressure_pa": -3000 } } }));
    first.until("below ambient", |page| page.happened("a pressure of -3 kPa: must be from"));

    assert_no_file_is_shown(&served, &mut first);

    let mut second = served.page();
    second.until("a seat", |page| page.own.is_object());
    assert_eq!(second.own["steers"], false);
    second.order(json!({ "set": { "Pressure": { "pressure_pa": 2e5 } } }));
    second.until("watches", |page| page.happened("another page steers"));
    assert!((second.pressure_pa() - 1.3e5).abs() < 5e3, "{}", second.frame);

    assert_a_flood_is_logged_once(&mut second);

    // From the page to the board and back. Orders before a vent is carried out are dropped.
    first.until("vents", |page| page.frame["mode"] == "vent");
    let mut slowest = Duration::ZERO;
    for _ in 0..5 {
        first.drive(1.3e5);
        first.say(json!("vent"));
        let vented = first.until("vent", |page| page.frame["mode"] == "vent");
        slowest = slowest.max(vented);
    }
    println!("vented {slowest:?} after the page said so, at worst of five");

    first.drive(1.3e5);
    // The page is up to date before the other one closes.
    let began = Instant::now();
    second.until("driven", |page| {
        began.elapsed() > Duration::from_millis(500) && page.frame["mode"] != "vent"
    });
    drop(first);
    let until_vented = second.until("vents", |page| page.frame["mode"] == "vent");
    println!("vented {until_vented:?} after the page was gone");
    second.until("takes over", |page| page.own["steers"] == true);
    second.until("reported", |page| page.happened("the page that steered was closed"));
    second.drive(1.2e5);
    second.socket.send(Message::binary(&b"\"vent\""[..])).unwrap();
    second.until("vents on a binary frame", |page| page.frame["mode"] == "vent");

    // A second server does not take the board away.
    let other = served.bench.refused("thermyo serve scenarios/contraction.toml --out out/other");
    assert!(other.contains("emulated: another program has it open"), "{other}");

    let text = served.end("-INT");
    assert!(text.contains("it vents"), "{text}");
}

/// A muscle that is driven and recorded.
#[cfg(unix)]
fn recording() -> (Served, Page) {
    let served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.drive(1.3e5);
    page.order(json!("record"));
    page.until("rows", |page| page.state["recording"]["rows"].as_u64() > Some(0));
    (served, page)
}

/// Each of them used to replace the board of the one before, which lost its link.
#[test]
fn servers_started_at_once_do_not_replace_each_others_board() {
    let _turn = ONE_BY_ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let bench = Bench::new();
    let start = |number| {
        let line = format!("thermyo serve scenarios/contraction.toml --out out/serve-{number}");
        let mut command = bench.command(&line);
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let mut servers = [0, 1, 2].map(start);
    let addresses = servers.each_mut().map(|server| {
        let mut address = String::new();
        BufReader::new(server.stdout.as_mut().unwrap()).read_line(&mut address).unwrap();
        address
    });
    for (mut server, address) in servers.into_iter().zip(&addresses) {
        if address.is_empty() {
            let said = Said::of("thermyo serve", server.wait_with_output().unwrap()).ends(2);
            assert!(said.err.contains("another program has it open"), "{}", said.err);
        } else {
            let _ = server.kill();
            let _ = server.wait();
        }
    }
    let served = addresses.iter().filter(|address| address.starts_with("http://")).count();
    assert_eq!(served, 1, "{addresses:?}");
}

/// The terminal is closed.
#[cfg(target_os = "linux")]
#[test]
fn a_hangup_vents_and_writes_the_report() {
    let (mut served, _page) = recording();
    let text = served.end("-HUP");
    assert!(text.starts_with("it vents\nreport: "), "{text}");
    let report = served.bench.path("out/serve/record-1/report.html");
    assert!(text.contains(&report.display().to_string()), "{text}");
    assert!(fs::read_to_string(report).unwrap().contains("<svg"));
    let info = served.bench.vented();
    assert!(!info.contains("link"), "{info}");
}

/// `timeout` and some supervisors send the signal to the command and then to its group.
#[cfg(unix)]
#[test]
fn a_second_sigterm_does_not_cut_the_report_off() {
    let (mut served, _page) = recording();
    served.signal("-TERM");
    let text = served.end("-TERM");
    assert!(text.starts_with("it vents\nreport: "), "{text}");
}

/// A server that ends without a link claims nothing about the valves.
#[test]
fn a_server_that_has_lost_its_board_does_not_claim_that_it_vents() {
    let mut served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.drive(1.3e5);
    served.bench.ok("thermyo board emulated unplug");
    page.until("lost", |page| page.state["link"] == "lost");
    let text = served.end("-INT");
    assert!(!text.contains("it vents"), "{text}");
}

/// Started as by `nohup`.
#[cfg(target_os = "linux")]
#[test]
fn a_hangup_that_is_ignored_stays_so() {
    let mut served = Served::after("trap '' HUP", "scenarios/contraction.toml");
    let mut page = served.page();
    page.drive(1.3e5);
    served.signal("-HUP");
    page.drive(1.4e5);
    assert!(served.end("-INT").contains("it vents"));
}

#[cfg(unix)]
#[test]
fn half_open_connections_take_neither_the_page_nor_a_recording() {
    let served = Served::after("ulimit -n 128", "scenarios/contraction.toml");
    let host = served.host().to_owned();
    let mut page = served.page();
    page.drive(1.3e5);
    let strangers: Vec<TcpStream> = (0..300)
        .map(|_| {
            let mut stranger = TcpStream::connect(&host).unwrap();
            // A connection that was closed to make room does not accept the bytes.
            let _ = stranger.write_all(b"GET / HTTP/1.1\r\n");
            stranger
        })
        .collect();
    page.order(json!("record"));
    page.until("rows", |page| page.state["recording"]["rows"].as_u64() > Some(100));
    assert_eq!(served.get(&served.path("page.js"), &host).0, 200);
    page.order(json!("finish"));
    page.until("a result", |page| page.state["results"][0]["name"] == "record-1");
    drop(strangers);
    let trace = fs::read_to_string(served.bench.path("out/serve/record-1/trace.csv")).unwrap();
    assert!(trace.lines().count() > 100, "{trace}");
}

/// Measures the time from a page's Vent to the frame that shows it to that page.
#[test]
#[ignore = "measures a time"]
fn a_vent_among_a_thousand_orders_a_second() {
    const VENTS: usize = 50;
    const ORDERS: u32 = 1000;
    let mut served = Served::new("scenarios/contraction.toml");
    let mut steering = served.page();
    steering.drive(1.3e5);
    let mut venting = served.page();
    venting.until("a seat", |page| page.own["steers"] == false);
    let ends = Arc::new(AtomicBool::new(false));
    let flood = std::thread::spawn({
        let ends = Arc::clone(&ends);
        move || {
            steering.socket.get_ref().set_read_timeout(Some(Duration::from_micros(100))).unwrap();
            let (start, mut sent) = (Instant::now(), 0);
            while !ends.load(Ordering::Relaxed) {
                while sent < (start.elapsed().as_secs_f64() * f64::from(ORDERS)) as u32 {
                    let pressure_pa = 1.3e5 + f64::from(sent % 100);
                    match sent % 50 {
                        0 => steering.order(json!({ "arm": { "most_pa": null } })),
                        _ => steering.order(
                            json!({ "set": { "Pressure": { "pressure_pa": pressure_pa } } }),
                        ),
                    }
                    sent += 1;
                }
                steering.hear(true);
            }
            f64::from(sent) / start.elapsed().as_secs_f64()
        }
    });
    let drives =
        |page: &Page| page.frame["mode"].as_str().is_some_and(|mode| mode.starts_with("pressure"));
    let mut times: Vec<Duration> = (0..VENTS)
        .map(|_| {
            venting.until("it drives", drives);
            venting.say(json!("vent"));
            venting.until("it vents", |page| !drives(page))
        })
        .collect();
    ends.store(true, Ordering::Relaxed);
    let orders_s = flood.join().unwrap();
    times.sort();
    println!(
        "{VENTS} vents under {orders_s:.0} orders a second: shown to the page that asked after {:.1?} (median), {:.1?} \
         at worst",
        times[VENTS / 2],
        times[VENTS - 1]
    );
    let text = served.end("-INT");
    assert!(text.contains("it vents"), "{text}");
}

#[test]
fn a_lost_link_is_shown_and_comes_back() {
    let served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.drive(1.3e5);
    assert_eq!(page.state["configuration"]["name"], "contraction");
    served.bench.ok("thermyo board emulated unplug");
    let lost = page.until("lost", |page| page.state["link"] == "lost");
    served.bench.ok("thermyo board emulated plug");
    let back = page
        .until("back", |page| page.state["link"] == "connected" && page.frame["mode"] == "vent");
    println!("shown as lost after {lost:?}, back {back:?} after it was plugged in");
    page.until("it has forgotten its muscle", |page| {
        page.state["faults"].as_array().unwrap().contains(&json!("not configured"))
    });
    page.drive(1.2e5);
}

#[test]
fn a_slow_page_loses_frames_and_the_record_none() {
    let served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.drive(1.3e5);
    let mut slow = served.page();
    page.order(json!("record"));
    page.until("it records", |page| page.state["recording"].is_object());
    let began = Instant::now();
    while page.state["recording"]["rows"].as_u64() < Some(3000) {
        assert!(began.elapsed().as_secs_f64() < HANGS_S, "{}", page.state["recording"]);
        page.hear(true);
        slow.hear(false);
    }
    assert!(slow.received < 40, "{} messages to a page that sees none", slow.received);
    slow.until("reported", |page| page.own["lost_frames"].as_u64() > Some(20));
    // A busy machine may delay this page too, but the slow page does not.
    assert!(page.own["lost_frames"].as_u64() < slow.own["lost_frames"].as_u64());
    page.say(json!("vent"));
    page.order(json!("finish"));
    page.until("a result", |page| page.state["results"][0]["name"] == "record-1");
    let host = served.host().to_owned();
    let (status, summary) = served.get(&served.path("results/record-1/summary.json"), &host);
    let summary: Value = serde_json::from_str(summary.split("\r\n\r\n").nth(1).unwrap()).unwrap();
    assert_eq!((status, &summary["lost_steps"]), (200, &json!(0)), "{summary}");
    let (status, report) = served.get(&served.path("results/record-1/report.html"), &host);
    assert!(status == 200 && report.contains("sandbox allow-scripts"), "{status}");
    let trace = fs::read_to_string(served.bench.path("out/serve/record-1/trace.csv")).unwrap();
    let times: Vec<f64> =
        trace.lines().skip(1).map(|row| row.split(',').next().unwrap().parse().unwrap()).collect();
    assert!(times.len() >= 3000, "{} rows", times.len());
    // The record began while the core ran, and is replayed from its first step.
    let replayed = served.bench.ok("thermyo replay out/serve/record-1 --out out/again");
    assert!(replayed.contains("the record has no start of the core: replayed from its step "));
    assert!(times.windows(2).all(|pair| (pair[1] - pair[0] - 1e-3).abs() < 1e-9));

    // A page that controls but does not acknowledge counts as lost: the muscle is unattended.
    page.order(json!({ "set": { "Pressure": { "pressure_pa": 1.3e5 } } }));
    slow.until("driven", |page| page.frame["mode"].as_str().unwrap().starts_with("pressure"));
    slow.until("gone", |page| page.frame["mode"] == "vent" && page.own["steers"] == true);
    assert!(slow.happened("does not answer"));
}

#[test]
fn a_sensor_is_calibrated_step_by_step() {
    let served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.until("a state", |page| page.state.is_object());
    page.until("configured", |page| page.state["configuration"]["configured"] == true);
    let checksum = page.state["configuration"]["checksum"].clone();
    page.order(json!({ "calibrate": "pressure" }));
    page.until("asked", |page| page.state["guide"]["asks"] == "Pa");
    page.order(json!({ "reference": "one bar" }));
    let guided = |page: &Page, what| page.state["guide"]["text"].as_str().unwrap().contains(what);
    page.until("no number", |page| guided(page, "the reference must be a number in Pa"));
    // The first point is read vented, in the page's unit, and refused at once.
    page.drive(3.0e5);
    page.order(json!({ "reference": "101.3 kPa" }));
    page.until("driven", |page| guided(page, "it does not vent"));
    page.order(json!({ "set": "Vent" }));
    page.until("vented", |page| page.frame["mode"] == "vent" && page.pressure_pa() < 1.03e5);
    page.order(json!({ "reference": "101.3" }));
    page.until("another unit", |page| guided(page, "reads 0.10 kPa and the sensor 10"));
    page.order(json!({ "reference": "101.325 kPa" }));
    page.until("asked again", |page| guided(page, "second point"));
    page.drive(3.0e5);
    // A sensor with an error of 1 %.
    page.order(json!({ "reference": "303000" }));
    page.until("put right", |page| page.state["guide"]["over"] == true);
    let text = page.state["guide"]["text"].as_str().unwrap().to_owned();
    assert!(text.starts_with("Put right by") && text.contains(" kPa"), "{text}");
    page.until("vents", |page| page.frame["mode"] == "vent");
    // The former configuration is one click away.
    assert_eq!(page.state["guide"]["chooses"], true);
    page.until("calibrated", |page| page.state["configuration"]["checksum"] != checksum);
    page.order(json!("back"));
    page.until("back", |page| page.state["configuration"]["checksum"] == checksum);
    assert!(page.state["guide"].is_null(), "{}", page.state["guide"]);
}

#[test]
fn stops_are_measured_from_the_page_until_somebody_vents() {
    let served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.configured();
    let progress = |page: &Page| page.state["guide"]["progress"].as_f64().unwrap_or(0.0);
    page.order(json!({ "stops": { "most_pa": 1.2e5 } }));
    page.until("bounded", |page| page.happened("warms the gas too little"));
    page.order(json!({ "stops": { "most_pa": 4.0e5 } }));
    page.until("it moves", |page| progress(page) > 0.001);
    assert_eq!(page.state["guide"]["title"], "Stops");
    assert_eq!(page.state["armed_pa"], 4e5);
    page.say(json!("vent"));
    page.until("vents", |page| page.frame["mode"] == "vent");
    page.until("ended", |page| page.state["guide"]["over"] == true);
    let text = page.state["guide"]["text"].as_str().unwrap_or("").to_owned();
    assert!(text.starts_with("Ended at ") && text.contains("only 0 of 8 stops"), "{text}");
    assert_eq!(page.state["guide"]["result"], "stops-1");
    assert!(served.bench.path("out/serve/stops-1/trace.csv").exists());
}

#[test]
fn a_muscle_is_tuned_from_the_page() {
    let served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.configured();
    let checksum = page.state["configuration"]["checksum"].clone();
    let progress = |page: &Page| page.state["guide"]["progress"].as_f64().unwrap_or(0.0);
    let text = |page: &Page| page.state["guide"]["text"].as_str().unwrap_or("").to_owned();

    page.order(json!({ "tune": { "most_pa": 1e300 } }));
    page.until("bounded", |page| {
        page.happened("of 1e300 Pa: must be from 101325 Pa (ambient) to ")
    });

    // Venting stops the tuning, without a result.
    page.order(json!({ "tune": { "most_pa": 4.0e5 } }));
    page.until("it moves", |page| progress(page) > 0.01 && page.pressure_pa() > 1.1e5);
    assert_eq!(page.state["guide"]["title"], "Tuning");
    assert_eq!(page.state["armed_pa"], 4e5);
    page.order(json!("record"));
    page.until("nothing beside it", |page| page.happened("to vent ends that"));
    page.say(json!("vent"));
    page.until("vents", |page| page.frame["mode"] == "vent");
    page.until("ended", |page| page.state["guide"]["over"] == true);
    assert_eq!(text(&page), "Nothing was tuned: Vent was pressed on a page; the board vents.");
    assert_eq!(page.state["results"], json!([]));
    assert!(!served.bench.path("out/serve/tune-1").exists());

    // A complete tuning: the board has other values, the page their report.
    page.order(json!("leave"));
    page.until("left", |page| page.state["guide"].is_null());
    page.order(json!({ "tune": { "most_pa": 4.0e5 } }));
    page.until("it runs", |page| progress(page) > 0.0);
    let over = |page: &Page| page.state["guide"]["over"] == true;
    while !over(&page) {
        let before = text(&page);
        page.until("it goes on", |page| over(page) || text(page) != before);
    }
    assert!(
        text(&page).starts_with("with the tuned values a sine is followed "),
        "{}",
        text(&page)
    );
    assert_eq!(page.state["guide"]["table"][0][0], "friction.force_n");
    assert_eq!(page.state["guide"]["result"], "tune-1");
    page.until("vents", |page| page.frame["mode"] == "vent");
    // Values that make it worse are not left on the board.
    let adopted = page.state["guide"]["chooses"] == true;
    let has = |page: &Page| (page.state["configuration"]["checksum"] != checksum) == adopted;
    page.until("the better values", has);
    if adopted {
        page.order(json!("back"));
        page.until("back", |page| page.state["configuration"]["checksum"] == checksum);
    }
    assert_the_tuning_is_written(&served, adopted);
}

fn assert_the_tuning_is_written(served: &Served, adopted: bool) {
    let (status, report) = served.get(&served.path("results/tune-1/report.html"), served.host());
    assert_eq!(status, 200);
    assert!(report.contains("<svg"));
    let tuned = fs::read_to_string(served.bench.path("out/serve/tune-1/tuned.toml")).unwrap();
    assert!(tuned.contains("[believed."), "{tuned}");
    // The muscle follows the pins after the valve's 1 ms, half of its 2 ms, and the sensor's lag.
    let summary = fs::read(served.bench.path("out/serve/tune-1/summary.json")).unwrap();
    let summary: Value = serde_json::from_slice(&summary).unwrap();
    let delay_s = summary["delay_s"].as_f64().unwrap();
    assert!((0.002..0.004).contains(&delay_s), "{delay_s}");
    assert_eq!(summary["adopted"], adopted);
}

#[test]
fn the_page_in_a_browser() {
    let Some(chromium) = crate::browser_support::Chromium::find() else { return };
    let served = Served::new("emulated");
    let place = served.bench.path("");
    let server = served.child.id().to_string();
    let more = [env!("CARGO_BIN_EXE_thermyo").as_ref(), place.as_os_str(), server.as_ref()];
    let seen = chromium.look("serve.mjs", served.url.as_ref(), "serve", &more);
    assert_eq!(seen["problems"], json!([]), "{seen}");
    assert_eq!(seen["first"], json!({ "armed": true, "readings": true }), "{seen}");
    assert_eq!(seen["most"][0], "150.0", "{seen}");
    let most = seen["most"][1].as_str().unwrap();
    assert!(most.starts_with("1500.0 kPa: must be from 101.3 to 660.1 kPa."), "{seen}");
    assert_eq!((&seen["most"][2], &seen["most"][3]), (&json!("400"), &json!("400.0")), "{seen}");
    assert_the_page_is_of_a_piece(&seen);
    assert_records_are_used(&seen);
    let in_bar = &seen["in_bar"];
    let pressure_bar = in_bar["pressure"].as_f64().unwrap();
    assert!((3.2..3.4).contains(&pressure_bar), "{seen}");
    assert_eq!(
        (&in_bar["field"], &in_bar["armed"]),
        (&json!("3.300"), &json!("armed up to 4.000 bar"))
    );
    assert!((0.0..60.0).contains(&in_bar["gas"].as_f64().unwrap()), "{seen}");
    let typed = seen["refused"][0].as_str().unwrap();
    assert!(
        typed.starts_with("Type a number in kPa, or with its unit: Pa, kPa, MPa, bar, "),
        "{seen}"
    );
    let range = seen["refused"][1].as_str().unwrap();
    assert!(
        range.starts_with("-3.0 kPa: must be from 101.3 to ") && range.ends_with(" kPa."),
        "{seen}"
    );
    // The typed set point is driven, and the pressure follows.
    let reached_kpa = seen["reached_kpa"].as_f64().unwrap();
    assert!((148.0..152.0).contains(&reached_kpa), "{seen}");
    assert!(seen["hovered"].as_str().unwrap().contains("kPa"), "{seen}");
    assert_ne!(seen["hovered"], seen["not_hovered"], "{seen}");
    assert!(seen["driven"].as_str().unwrap().starts_with("pressure"), "{seen}");
    let (lost_ms, back_ms) = (seen["lost_ms"].as_f64().unwrap(), seen["back_ms"].as_f64().unwrap());
    println!(
        "link lost: shown after {lost_ms:.0} ms, back {back_ms:.0} ms after it was plugged in"
    );
    assert!(lost_ms > 0.0 && back_ms > 0.0, "{seen}");
    assert_ne!(seen["lost_armed"].as_str().unwrap().find("armed up to"), Some(0), "{seen}");
    let vented = seen["vented_ms"].as_array().unwrap().iter().map(|ms| ms.as_f64().unwrap());
    let vented_ms: Vec<f64> = vented.collect();
    println!("vented by the space key, in the browser: {vented_ms:.0?} ms");
    assert_eq!(vented_ms.len(), 5, "{seen}");
    let armed = json!(["armed up to 390.0 kPa", "armed up to 380.0 kPa"]);
    assert_eq!(seen["let_go"], armed, "a slide that was held drives: {seen}");
    assert_eq!(seen["watching"], true, "{seen}");
    assert!(seen["report"].as_str().unwrap().contains("record-1"), "{seen}");
    assert_eq!(seen["narrow_px"], 390, "{seen}");
    assert_eq!(seen["temperature_above"], true, "{seen}");
    assert_eq!(seen["serious"], json!([]), "{seen}");
    let killed = json!({ "other": false, "armed": "was armed", "mode": "was vent", "set": false });
    assert_eq!(seen["killed"], killed, "{seen}");
}

/// The card of records: its keyboard, messages and widths.
fn assert_records_are_used(seen: &Value) {
    assert_eq!(seen["ticked"], json!([false, true, true, false, false]), "{seen}");
    let refused = seen["not_identified"].as_str().unwrap();
    assert!(refused.starts_with("second.csv: column duty_in is missing"), "{seen}");
    let warning =
        "Warning: second.csv lasts 19.9 s and first.csv 29.9 s: only the common time is compared.";
    assert!(seen["compared"].as_str().unwrap().contains(warning), "{seen}");
    assert_eq!(seen["records_px"], json!([1280, 390]), "{seen}");
}

/// Checks colours, units and widths of the page's parts.
fn assert_the_page_is_of_a_piece(seen: &Value) {
    assert_eq!(seen["palette"][0], seen["palette"][1], "{seen}");
    let calibrates = seen["calibrates"].as_str().unwrap();
    assert!(calibrates.contains("The reference reads 101.30 kPa, the sensor 10"), "{seen}");
    let saved = seen["saved"].as_str().unwrap();
    assert!(["Pressure, absolute", "set point"].iter().all(|text| saved.contains(text)), "{seen}");
    assert_eq!(seen["covered"], json!([]), "{seen}");
    for room_px in seen["table_px"].as_array().unwrap() {
        assert!((0.0..60.0).contains(&room_px.as_f64().unwrap()), "{seen}");
    }
    assert!(seen["palette"][0].as_array().unwrap().iter().all(Value::is_string), "{seen}");
    assert_eq!(seen["ends"][0], seen["ends"][1], "the muscle's colours: {seen}");
}

/// A record at 1 kHz over ten minutes, or `THERMYO_SERVE_S` seconds.
#[test]
#[ignore = "ten minutes in real time"]
fn ten_minutes_lose_nothing() {
    let duration_s: f64 =
        std::env::var("THERMYO_SERVE_S").ok().and_then(|s| s.parse().ok()).unwrap_or(600.0);
    let served = Served::new("scenarios/contraction.toml");
    let pid = served.child.id();
    let used = || {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
        let fields: Vec<u64> = stat
            .rsplit(')')
            .next()
            .unwrap()
            .split_whitespace()
            .map(|f| f.parse().unwrap_or(0))
            .collect();
        (fields[11] + fields[12]) as f64 / 100.0
    };
    let resident_mb = || {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap().to_owned();
        line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
    };
    let mut page = served.page();
    page.drive(1.3e5);
    page.order(json!("record"));
    page.until("it records", |page| page.state["recording"].is_object());
    let (start, start_s) = (Instant::now(), used());
    let (mut early_mb, mut largest_mb, mut next_s) = (f64::NAN, 0.0_f64, 0.0);
    while start.elapsed().as_secs_f64() < duration_s {
        page.hear(true);
        let time_s = start.elapsed().as_secs_f64();
        if early_mb.is_nan() && time_s > 0.25 * duration_s {
            early_mb = resident_mb();
        }
        if time_s > next_s {
            next_s += 2.0;
            largest_mb = largest_mb.max(resident_mb());
            let pressure_pa = if ((time_s / 2.0) as u64).is_multiple_of(2) { 1.3e5 } else { 2.2e5 };
            page.order(json!({ "set": { "Pressure": { "pressure_pa": pressure_pa } } }));
        }
    }
    let share = (used() - start_s) / start.elapsed().as_secs_f64();
    let late_mb = resident_mb();
    page.order(json!("finish"));
    page.until("a result", |page| page.state["results"][0].is_object());
    println!(
        "{duration_s} s: {}; {:.1} % of a core; resident {early_mb:.1} MB after a quarter, {late_mb:.1} MB in the \
         end, {largest_mb:.1} MB at most; telemetry of {} steps lost; frames lost by the page: {}",
        page.state["results"][0]["text"],
        share * 100.0,
        page.state["lost_steps"],
        page.own["lost_frames"]
    );
    assert!(page.state["results"][0]["text"].as_str().unwrap().contains(", 0 lost"));
    assert!((0.001..0.3).contains(&share), "{share}");
    assert!(late_mb - early_mb < 8.0, "{early_mb} MB, then {late_mb} MB");
}
