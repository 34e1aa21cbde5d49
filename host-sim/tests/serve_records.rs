//! Identification and comparison of records on the page of `thermyo serve`.

use crate::board_support::repository;
use crate::serve::{Page, Served};
use crate::static_map::{grid, map};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::net::TcpStream;

impl Served {
    /// Status and text of the answer to a file, whose stated length need not be true.
    fn send(&self, length: usize, bytes: &[u8]) -> (u16, String) {
        let mut stream = TcpStream::connect(self.host()).unwrap();
        let (path, host) = (self.path("files"), self.host());
        let head = format!("Host: {host}\r\nContent-Length: {length}\r\nConnection: close\r\n");
        write!(stream, "POST {path} HTTP/1.1\r\n{head}\r\n").unwrap();
        stream.write_all(bytes).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        (head.split(' ').nth(1).unwrap().parse().unwrap(), body.to_owned())
    }

    /// Sends a file to keep; returns its form in orders.
    fn keeps(&self, name: &str, text: &str) -> Value {
        let (status, number) = self.send(text.len(), text.as_bytes());
        assert_eq!(status, 200, "{number}");
        json!({ "file": { "number": number.parse::<u64>().unwrap(), "name": name } })
    }
}

impl Page {
    fn identify(&mut self, data: &Value, sought: &str, keys: &[&str]) {
        self.order(json!({ "identify": { "data": data, "sought": sought, "keys": keys } }));
    }

    /// Waits for the end of the study; returns its text.
    fn studied(&mut self, what: &str) -> String {
        self.until("over", |page| {
            page.state["study"]["over"] == true && page.text().contains(what)
        });
        self.text()
    }

    fn text(&self) -> String {
        self.state["study"]["text"].as_str().unwrap_or_default().to_owned()
    }

    fn refused(&mut self, why: &str) {
        self.until(why, |page| {
            page.state["study"]["refused"].as_str().is_some_and(|text| text.contains(why))
        });
    }
}

/// Static readings of the scenario's muscle, which is 3 % thicker than the scenario states.
fn thicker() -> String {
    let loaded = thermyo_setup::load(&repository().join("scenarios/contraction.toml")).unwrap();
    let muscle = &loaded.plant.muscle;
    let (rest_m, diameter_m) = (muscle.rest_length_m, 1.03 * muscle.diameter_m);
    let thicker = thermyo_scenario::at_rest(muscle, rest_m, diameter_m, muscle.braid_angle_deg);
    map(&thicker, &grid(&[0.0]), 0.2, 0.0, 1)
}

#[test]
fn identified_values_are_applied_and_taken_back() {
    let served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.configured();
    let checksum = page.state["configuration"]["checksum"].clone();
    let mut watcher = served.page();
    watcher.until("it watches", |page| page.own["steers"] == false);

    // The message of the command, with file, line and column.
    let wrong = served.keeps("wrong.csv", &thicker().replace("\n0.3,", "\n300,"));
    page.identify(&wrong, "force", &[]);
    let text = page.studied("wrong.csv:2: column rest_length_m = 300.0: must be");
    assert!(!text.contains('\n'), "{text}");
    let readings = served.keeps("map.csv", &thicker());
    page.identify(&readings, "heat", &["heat.inner_w_m2_k"]);
    page.studied("map.csv: a table of static readings, which shows the force of the muscle only");

    page.identify(&readings, "force", &[]);
    let text = page.studied("Found from map.csv.");
    let study = &page.state["study"];
    assert_eq!(study["applies"], true, "{text}");
    let rows = study["rows"].as_array().unwrap();
    let diameter = rows.iter().find(|row| row[0] == "muscle.diameter_m").unwrap();
    assert!(diameter[2].as_str().unwrap().contains('±'), "{diameter}");
    assert_eq!(page.state["configuration"]["checksum"], checksum, "nothing is applied by itself");
    let (status, drawing) = served.get(&served.path("results/identify-1/map.svg"), served.host());
    assert!(status == 200 && drawing.contains("<svg"), "{drawing}");
    assert!(served.bench.path("out/serve/identify-1/identified.toml").exists());

    // Applying is refused for a page that watches, and while the muscle is driven.
    watcher.order(json!("apply"));
    page.until("refused", |page| page.happened("another page steers"));
    page.drive(2.0e5);
    page.order(json!("apply"));
    page.refused("vent first");
    assert_eq!(page.state["configuration"]["checksum"], checksum);
    page.order(json!({ "set": "Vent" }));
    page.until("vents", |page| page.frame["mode"] == "vent");
    page.order(json!("apply"));
    page.until("applied", |page| {
        let study = &page.state["study"];
        page.state["configuration"]["checksum"] != checksum && study["chooses"] == true
    });
    page.order(json!("back"));
    page.until("back", |page| page.state["configuration"]["checksum"] == checksum);
    assert!(page.state["study"].is_null(), "{}", page.state["study"]);
}

/// Motion at 2 Hz for `duration_s` seconds, 100 rows each.
fn motion(duration_s: u32) -> String {
    let mut text = "time_s,pressure_pa,length_m,duty_in,duty_out,sensor_gas_k\n".to_owned();
    for row in 0..100 * duration_s {
        let time_s = f64::from(row) / 100.0;
        let sine = (12.6 * time_s).sin();
        let (pressure_pa, length_m, sensor_k) =
            (2.5e5 + 1.0e5 * sine, 0.22 - 0.02 * sine, 298.0 + 2.0 * sine);
        let [inlet, outlet] = if (12.6 * time_s).cos() > 0.0 { [0.5, 0.0] } else { [0.0, 1.0] };
        writeln!(text, "{time_s},{pressure_pa},{length_m},{inlet},{outlet},{sensor_k}").unwrap();
    }
    text
}

#[test]
fn the_board_is_steered_while_a_fit_goes_on_until_it_is_cancelled() {
    let served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.configured();
    let data = served.keeps("motion.csv", &motion(600));
    let keys = ["heat.inner_w_m2_k", "wall.heat_capacity_j_k", "sensor.gas.time_constant_s"];
    page.identify(&data, "heat", &keys);
    let works = |page: &Page| page.state["study"]["progress"].is_number();
    page.until("it works", works);
    page.drive(1.5e5);
    page.drive(2.5e5);
    page.identify(&data, "heat", &keys);
    page.until("one at a time", |page| page.happened("wait for it, or cancel it"));
    assert!(works(&page), "it has ended too early for this test: {}", page.state["study"]);
    page.order(json!("close"));
    page.studied("Cancelled: nothing was kept.");
    assert!(!served.bench.path("out/serve/identify-1").exists());
    page.order(json!("close"));
    page.until("closed", |page| page.state["study"].is_null());
}

#[test]
fn two_records_are_compared_as_the_command_does() {
    let served = Served::new("scenarios/contraction.toml");
    let mut page = served.page();
    page.configured();
    let record = |pressures: &str| format!("time_s,pressure_pa\n{pressures}");
    let first = served.keeps("first.csv", &record("0,100000\n1,200000\n2,300000\n"));
    let second = served.keeps("second.csv", &record("0,103000\n1,203000\n"));
    page.order(json!({ "compare": [first, second] }));
    let text = page.studied("second.csv less first.csv, at 2 rows of both.");
    let warning =
        "Warning: second.csv lasts 1 s and first.csv 2 s: only the common time is compared.";
    assert!(text.contains(warning), "{text}");
    let rows = &page.state["study"]["rows"];
    assert_eq!(rows[0], json!(["pressure", "3.00 kPa", "3.00 kPa", "3.00 kPa"]));
    assert!(served.bench.path("out/serve/compare-1/report.html").exists());

    // A recording of the session is a record too.
    page.order(json!("record"));
    page.until("rows", |page| page.state["recording"]["rows"].as_u64() > Some(200));
    page.order(json!("finish"));
    page.until("recorded", |page| page.state["results"][0]["name"] == "record-1");
    assert_eq!(page.state["results"][0]["trace"], true);
    page.order(json!({ "compare": [first, { "result": "record-1" }] }));
    page.studied("record-1 less first.csv");
    page.order(json!({ "compare": [first, { "result": "record-7" }] }));
    page.studied("that record is no longer here");

    let (status, text) = served.send((64 << 20) + 1, b"time_s");
    assert_eq!((status, text.contains("64 MiB")), (413, true), "{text}");
}
