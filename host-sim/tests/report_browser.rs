//! The report pages in headless Chromium, used as by a reader.

use serde_json::Value;
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

use crate::browser_support::Chromium;

/// Runs `thermyo` with these arguments and `--out` in a folder; returns the page.
fn page(folder: &TempDir, name: &str, arguments: &[&str]) -> PathBuf {
    let out = folder.path().join(name);
    let output = Command::new(env!("CARGO_BIN_EXE_thermyo"))
        .args(arguments)
        .args(["--quiet", "--out"])
        .arg(&out)
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    out.join("report.html")
}

/// Checks that apply to every page; returns the script's findings.
fn looked_into(chromium: &Chromium, page: &Path, name: &str, figures: usize) -> Value {
    let seen = chromium.look("look.mjs", page.as_os_str(), name, &[]);
    assert_eq!(seen["problems"], Value::Array(Vec::new()), "{name}");
    for mode in ["figures", "without_script"] {
        let all = seen[mode].as_array().unwrap();
        assert_eq!(all.len(), figures, "{name}: {mode}");
        assert!(all.iter().all(|figure| figure["drawn"] == true), "{name}: {all:?}");
    }
    let charts = seen["charts"].as_array().unwrap();
    assert!(!charts.is_empty(), "{name}");
    for chart in charts {
        let readout = chart["readout"].as_array().unwrap_or_else(|| panic!("{name}: {chart}"));
        assert!(readout.len() >= 2, "{name}: {chart}");
        assert!(
            readout
                .iter()
                .all(|row| row[1].as_str().unwrap().contains(|c: char| c.is_ascii_digit())),
            "{name}: {chart}"
        );
        assert!(chart["hair"].as_u64() >= Some(1), "{name}: {chart}");
        let downloads = &chart["downloads"];
        assert_eq!(downloads["names"], serde_json::json!(["csv", "svg"]), "{name}: {chart}");
        assert!(
            downloads["rows"].as_u64() > Some(2) && downloads["svg"] == "<svg",
            "{name}: {chart}"
        );
        let none = Value::Array(Vec::new());
        assert_eq!([&downloads["cut"], &downloads["unnamed"]], [&none; 2], "{name}: {chart}");
        assert!(downloads["head"].as_str().unwrap().contains("\",\""), "{name}: {chart}");
        assert_ne!(chart["zoomed"], chart["whole"], "{name}: {chart}");
        assert_ne!(chart["panned"], chart["zoomed"], "{name}: {chart}");
        assert_eq!(chart["back"], chart["whole"], "{name}: {chart}");
        // Charts without data in the window stay as they are, and print shows none of this.
        assert_eq!(chart["empty"], Value::Array(Vec::new()), "{name}: {chart}");
        assert_eq!(chart["printed"], chart["still"], "{name}: {chart}");
        let deep = chart["deep"].as_array().unwrap();
        let labels: HashSet<_> = deep.iter().map(Value::to_string).collect();
        assert_eq!(labels.len(), deep.len(), "{name}: {chart}");
        let shown = ["touched", "left", "keyed"].map(|how| chart[how].as_bool().unwrap());
        assert_eq!(shown, [true, false, true], "{name}: {chart}");
        let [all, without, again] = [0, 1, 2].map(|i| chart["traces"][i].as_u64());
        assert!(without.is_none() || without < all && again == all, "{name}: {chart}");
        assert_eq!(chart["struck"], "none", "{name}: {chart}");
        assert_eq!(chart["cut"], Value::Array(Vec::new()), "{name}: {chart}");
    }
    assert_eq!(seen["serious"], Value::Array(Vec::new()), "{name}");
    let narrow = &seen["narrow"];
    assert_eq!(narrow["page_px"], 390, "{name}: {narrow}");
    assert_eq!(narrow["cut"], Value::Array(Vec::new()), "{name}");
    assert!(narrow["smallest_text_px"].as_f64() >= Some(11.0), "{name}: {narrow}");
    for what in ["beyond_paper", "stacked", "unfolded"] {
        assert_eq!(seen[what], Value::Array(Vec::new()), "{name}: {what}");
    }
    seen
}

#[test]
fn pages_can_be_looked_into() {
    let Some(chromium) = Chromium::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let controlled = page(&folder, "contraction", &["run", "scenarios/contraction.toml"]);
    let seen = looked_into(&chromium, &controlled, "contraction", 5);
    let first = &seen["charts"][0];
    let names: Vec<&str> =
        first["readout"].as_array().unwrap().iter().map(|row| row[0].as_str().unwrap()).collect();
    assert_eq!(names, ["Time", "set point", "contraction", "Tracking error"]);
    // All charts over time are linked.
    assert_eq!(first["linked"].as_array().unwrap().len(), seen["charts"].as_array().unwrap().len());

    let measured = folder.path().join("measured.csv");
    fs::write(&measured, "time_s,pressure_pa,sensor_gas_k\n1,7e5,290\n20,2e5,270\n40,1.2e5,280\n")
        .unwrap();
    let measured = measured.display().to_string();
    let run = ["run", "scenarios/air_discharge.toml", "--measured", &measured];
    let vessel = page(&folder, "vessel", &run);
    looked_into(&chromium, &vessel, "vessel", 4);
    let text = fs::read_to_string(&vessel).unwrap();
    assert!(!text.contains("muscle answers") && !text.contains("last stroke"));

    let trace = folder.path().join("contraction/trace.csv").display().to_string();
    let replay = page(&folder, "replay", &["replay", &trace]);
    looked_into(&chromium, &replay, "replay", 1);

    let tune = page(&folder, "tune", &["tune", "scenarios/contraction.toml"]);
    let identified = folder.path().join("identify.toml");
    let text = "[plant]\nmodel = \"lumped\"\n[identify]\nstarts = 2\nparameters = [\"heat.scale\", \
                \"friction.force_n\"]\n";
    fs::write(&identified, text).unwrap();
    let identified = identified.display().to_string();
    let short = folder.path().join("short.toml");
    fs::write(&short, "[run]\nduration_s = 15\n[plant]\nmodel = \"lumped\"\n").unwrap();
    page(&folder, "short", &["run", &short.display().to_string()]);
    let data = folder.path().join("short/trace.csv").display().to_string();
    let identify = page(&folder, "identify", &["identify", &data, "--config", &identified]);
    let stops = ["measure", "stop", "scenarios/nominal.toml", "--stops", "3", "--wait", "10"];
    let stops = page(&folder, "stops", &stops);
    for (name, page) in [("tune", tune), ("identify", identify), ("stops", stops)] {
        let figures = fs::read_to_string(&page).unwrap().matches("<figure ").count();
        looked_into(&chromium, &page, name, figures);
    }

    let runs = ["contraction", "vessel"].map(|name| folder.path().join(name).display().to_string());
    let compare = page(&folder, "compare", &["compare", &runs[0], &runs[1]]);
    looked_into(&chromium, &compare, "compare", 3);
}

#[test]
fn the_paper_s_page_can_be_looked_into() {
    let folder = tempfile::tempdir().unwrap();
    let reproduce = page(&folder, "reproduce", &["reproduce"]);
    let text = fs::read_to_string(&reproduce).unwrap();
    // A bar of incoming energy is positive, and named accordingly.
    let value = |label: &str| {
        let row = text.split(&format!("text-anchor=\"end\">{label}<")).nth(1)?;
        let shown = row.split("class=\"value\"").nth(1)?.split(['>', '<']).nth(1)?;
        shown.replace('−', "-").parse::<f64>().ok()
    };
    assert!(value("heat from the wall").is_some_and(|joule| joule > 0.0));
    assert!(value("heat to the gas").is_some_and(|joule| joule < 0.0));
    let Some(chromium) = Chromium::find() else { return };
    let bytes = fs::metadata(&reproduce).unwrap().len();
    assert!((100_000..3_000_000).contains(&bytes), "{bytes} bytes");
    let figures = text.matches("<figure ").count();
    looked_into(&chromium, &reproduce, "reproduce", figures);
}
