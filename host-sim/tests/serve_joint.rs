//! `thermyo serve` of a joint, as pages use it, on the emulated board; and in headless Chromium.

use crate::board_support::repository;
use crate::serve::{Page, Served};
use serde_json::{Value, json};
use std::fs;

const SCENARIO: &str = "scenarios/joint_board.toml";
/// Indices in a row: angle \[rad\], and stiffness \[N m/rad\].
const ANGLE: usize = 1;
const STIFFNESS: usize = 3;

fn angle(angle_rad: f64) -> Value {
    json!({ "set_joint": { "Angle": {
        "angle_rad": angle_rad, "speed_rad_s": 0, "acceleration_rad_s2": 0, "stiffness_n_m_rad": 14
    } } })
}

impl Page {
    fn configured_joint(&mut self) {
        self.until("a state", |page| page.state.is_object() && page.own["steers"] == true);
        self.until("configured", |page| {
            page.state["configuration"]["configured"] == true && page.frame["mode"] == "vent"
        });
    }

    /// Arms, and holds an angle of 0.3 rad.
    fn drive_joint(&mut self) {
        self.order(json!({ "arm": { "most_pa": null } }));
        self.until("armed", |page| page.state["armed_pa"].is_number());
        self.order(angle(0.3));
        self.until("the angle follows", |page| {
            let driven = page.frame["set_point"]["Angle"].is_object();
            driven && (page.cell(ANGLE) - 0.3).abs() < 0.02
        });
    }

    fn vents(&mut self) {
        self.until("it vents", |page| page.frame["mode"] == "vent");
    }
}

#[test]
fn a_joint_is_steered_and_recorded_from_the_page() {
    let served = Served::plugged(SCENARIO, "", "emulated");
    let mut page = served.page();
    page.until("a state", |page| page.state.is_object() && page.own["steers"] == true);
    assert!(served.get(&served.path(""), served.host()).1.contains("data-kind=\"joint\""));
    let configuration = page.state["configuration"].clone();
    assert_eq!(configuration["joint"]["lock_s"], 0.0, "{configuration}");
    assert_eq!(configuration["own"], Value::Null, "{configuration}");
    page.order(json!({ "arm": { "most_pa": null } }));
    page.until("refused", |page| page.happened("has no configuration"));
    let text = fs::read_to_string(repository().join(SCENARIO)).unwrap();
    page.order(json!({ "configure": { "name": "muscle.toml", "text": "[muscle]\n" } }));
    page.until("no joint", |page| {
        page.happened("muscle.toml: has no [joint], and the board drives one")
    });
    page.order(json!({ "configure": { "name": "joint_board.toml", "text": text } }));
    page.configured_joint();
    assert_orders_for_one_muscle_are_refused(&mut page);

    page.order(angle(0.3));
    page.until("not armed", |page| page.happened("the joint is not armed"));
    page.order(json!("record"));
    page.until("it records", |page| page.state["recording"].is_object());
    page.drive_joint();
    page.order(angle(3.0));
    page.until("out of range", |page| page.happened("an angle of 171.8873 deg: must be from"));
    page.order(json!({ "set_joint": "Lock" }));
    page.until("never locks", |page| page.happened("joint.lock_s = 0"));
    page.until("stiff", |page| (page.cell(STIFFNESS) - 14.0).abs() < 1.5);

    let mut second = served.page();
    second.until("a seat", |page| page.own.is_object());
    second.order(angle(-0.3));
    second.until("watches", |page| page.happened("another page steers"));
    second.say(json!("vent"));
    second.vents();
    page.until("said", |page| page.happened("both muscles vent"));
    page.order(json!("finish"));
    page.until("a result", |page| page.state["results"][0]["name"] == "record-1");
    assert_the_record_is_a_joints(&served, &page);

    page.drive_joint();
    let stiff = json!({ "Torque": { "torque_n_m": 0.5, "stiffness_n_m_rad": 1000.0 } });
    page.order(json!({ "set_joint": stiff }));
    page.until("limited", |page| page.frame["limited"] == true);
    page.say(json!("vent"));
    page.vents();
    assert_eq!(page.frame["limited"], false, "{}", page.frame);

    page.drive_joint();
    second.until("driven", |page| page.frame["mode"] != "vent");
    drop(page);
    second.vents();
    second.until("reported", |page| page.happened("the page that steered was closed"));
}

/// Each order gets one message, and the board stays as it is.
fn assert_orders_for_one_muscle_are_refused(page: &mut Page) {
    let times = |page: &Page| {
        let events = page.state["events"].as_array().unwrap().iter();
        events.filter(|event| event["text"].as_str().unwrap().contains("drives a joint")).count()
    };
    for (i, order) in [
        json!({ "tune": { "most_pa": 4e5 } }),
        json!({ "stops": { "most_pa": 4e5 } }),
        json!({ "calibrate": "pressure" }),
        json!({ "identify": { "data": { "result": "record-1" }, "sought": "heat", "keys": [] } }),
        json!({ "compare": [{ "result": "record-1" }, { "result": "record-2" }] }),
        json!({ "set": { "Pressure": { "pressure_pa": 2e5 } } }),
    ]
    .into_iter()
    .enumerate()
    {
        page.order(order.clone());
        page.until(&order.to_string(), |page| times(page) == i + 1);
    }
    assert_eq!(page.state["study"], Value::Null);
    assert_eq!(page.frame["mode"], "vent");
}

fn assert_the_record_is_a_joints(served: &Served, page: &Page) {
    let result = &page.state["results"][0];
    assert_eq!(result["trace"], false, "{result}");
    let read = |name: &str| {
        fs::read_to_string(served.bench.path(&format!("out/serve/record-1/{name}"))).unwrap()
    };
    let trace = read("joint_trace.csv");
    assert!(trace.starts_with("time_s,angle_rad,angle_reference_rad,"), "{trace:.100}");
    let summary: Value = serde_json::from_str(&read("summary.json")).unwrap();
    let [least, most] = [0, 1].map(|i| summary["angle_rad"][i].as_f64().unwrap());
    assert!(least < 0.1 && (0.25..0.5).contains(&most), "{summary}");
    assert_eq!(summary["config_name"], "joint_board", "{summary}");
    assert!(read("scenario.toml").contains("[joint]"));
    for file in ["report.html", "joint_trace.csv"] {
        let path = served.path(&format!("results/record-1/{file}"));
        assert_eq!(served.get(&path, served.host()).0, 200, "{file}");
    }
    assert!(read("report.html").contains("Angle and stiffness"));
}

/// A lock is ended by Vent; a closed terminal vents a joint that is driven.
#[cfg(target_os = "linux")]
#[test]
fn a_joint_locks_from_the_page_and_a_hangup_vents_it() {
    let text = fs::read_to_string(repository().join(SCENARIO)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let locking = folder.path().join("locking.toml");
    fs::write(&locking, text.replace("[joint]", "[joint]\nlock_s = 600")).unwrap();
    let mut served = Served::new(&locking.display().to_string());
    let mut page = served.page();
    page.configured_joint();
    assert_eq!(page.state["configuration"]["own"], "locking");
    page.drive_joint();
    page.order(json!({ "set_joint": "Lock" }));
    page.until("it locks", |page| page.frame["mode"] == "locked");
    assert_eq!(page.frame["set_point"], "Lock");
    page.say(json!("vent"));
    page.vents();
    page.drive_joint();
    page.order(json!("record"));
    page.until("rows", |page| page.state["recording"]["rows"].as_u64() > Some(0));
    let text = served.end("-HUP");
    assert!(text.starts_with("it vents\nreport: "), "{text}");
    let info = served.bench.vented();
    assert!(!info.contains("link"), "{info}");
}

#[test]
fn the_page_of_a_joint_in_a_browser() {
    let Some(chromium) = crate::browser_support::Chromium::find() else { return };
    let served = Served::plugged(SCENARIO, "", "emulated");
    // Chromium reads no file by a path with "..".
    let scenario = repository().join(SCENARIO).canonicalize().unwrap();
    let (page, more) = (served.url.as_ref(), [scenario.as_os_str()]);
    let seen = chromium.look("serve_joint.mjs", page, "serve-joint", &more);
    assert_eq!(seen["problems"], json!([]), "{seen}");
    assert_eq!(seen["hidden"], json!([]), "{seen}");
    assert_eq!(seen["most"], "200.0", "{seen}");
    let refused = seen["refused"].as_str().unwrap();
    assert!(refused.starts_with("90.00 °: must be from -45.84 to 45.84 °."), "{seen}");
    for (i, degrees) in [20.0, -10.0, 25.0].into_iter().enumerate() {
        assert!((seen["reached"][i].as_f64().unwrap() - degrees).abs() < 1.5, "{seen}");
    }
    let units = ["°", "°", "N m/rad", "N m", "kPa", "kPa", "K", "K", "%", "%"];
    for (i, unit) in units.into_iter().enumerate() {
        assert!(seen["readings"][i].as_str().unwrap().ends_with(unit), "{seen}");
    }
    assert!((seen["drawn"].as_f64().unwrap() - 25.0).abs() < 2.0, "{seen}");
    let pressure = seen["pressure"].as_str().unwrap();
    assert!(pressure.starts_with("900.0 kPa: must be from 101.3 to 500.0 kPa."), "{seen}");
    assert_eq!(seen["in_bar"], json!(["2.000", "2.500"]), "{seen}");
    assert_eq!(seen["serious"], json!([]), "{seen}");
    assert_eq!(seen["narrow"], json!([1280, 390, 1280, 390]), "{seen}");
    assert_eq!(seen["large"], json!([0, 0, 0]), "{seen}");
    assert!(seen["events"].as_str().unwrap().contains("both muscles vent"), "{seen}");
}
