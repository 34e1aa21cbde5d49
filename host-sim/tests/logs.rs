//! Records in addition to `trace.csv`: the same numbers in another format, and over a socket.

use mcap::MessageStream;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::net::UdpSocket;
use std::path::Path;
use std::time::Duration;

use crate::command_support::{Folder, in_process as thermyo};

const SCENARIO: &str = "[run]\nduration_s = 0.3\nlog_every = 10\n[plant]\nmodel = \"lumped\"\n";

/// A table's rows, cells by column, without the empty ones.
fn rows(csv: &Path) -> Vec<BTreeMap<String, f64>> {
    let text = fs::read_to_string(csv).unwrap();
    let mut lines = text.lines().map(|line| line.split(','));
    let names: Vec<&str> = lines.next().unwrap().collect();
    let row = |cells: std::str::Split<'_, char>| {
        let known = names.iter().zip(cells).filter(|(_, cell)| !cell.is_empty());
        known.map(|(name, cell)| ((*name).to_owned(), cell.parse().unwrap())).collect()
    };
    lines.map(row).collect()
}

/// A flat JSON object of numbers, each exact to the last bit, which serde_json does not guarantee.
fn numbers(json: &[u8]) -> BTreeMap<String, f64> {
    let valid: BTreeMap<String, f64> = serde_json::from_slice(json).unwrap();
    let text = std::str::from_utf8(json).unwrap();
    let cells = text.trim_matches(['{', '}']).split(',').map(|cell| cell.split_once(':').unwrap());
    let exact: BTreeMap<String, f64> = cells
        .map(|(name, cell)| (name.trim_matches('"').to_owned(), cell.parse().unwrap()))
        .collect();
    assert!(valid.keys().eq(exact.keys()));
    exact
}

/// Numbers of all messages, joined by their time.
fn logged(mcap: &[u8]) -> Vec<BTreeMap<String, f64>> {
    let mut rows: BTreeMap<u64, BTreeMap<String, f64>> = BTreeMap::new();
    for message in MessageStream::new(mcap).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.clone().unwrap();
        assert_eq!(schema.encoding, "jsonschema");
        let schema: Value = serde_json::from_slice(&schema.data).unwrap();
        for (name, cell) in numbers(&message.data) {
            assert!(schema["properties"][&name]["description"].is_string(), "{name}");
            rows.entry(message.log_time).or_default().insert(name, cell);
        }
    }
    for (time_ns, row) in &rows {
        assert_eq!(*time_ns, (row["time_s"] * 1e9).round() as u64);
    }
    rows.into_values().collect()
}

#[test]
fn the_log_has_the_numbers_of_the_table_and_so_has_the_stream() {
    let folder = Folder::new();
    let scenario = folder.scenario(SCENARIO);
    let out = folder.path("out");
    let listener = UdpSocket::bind("127.0.0.1:0").unwrap();
    listener.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let to = format!("udp:{}", listener.local_addr().unwrap());
    let listening = std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        let mut datagrams: Vec<BTreeMap<String, f64>> = Vec::new();
        while datagrams.last().is_none_or(|row| row["time_s"] < 0.3) {
            // The last datagram may be lost.
            let Ok(length) = listener.recv(&mut bytes) else { break };
            datagrams.push(numbers(&bytes[..length]));
        }
        datagrams
    });
    let out_text = out.display().to_string();
    let arguments =
        ["run", &scenario, "--quiet", "--out", &out_text, "--log", "mcap", "--stream", &to];
    assert_eq!(thermyo(&arguments).ok().err, "");
    let rows = rows(&out.join("trace.csv"));
    assert_eq!(rows.len(), 31);
    assert_eq!(logged(&fs::read(out.join("trace.mcap")).unwrap()), rows);
    // Datagrams may be lost, but not invented.
    let datagrams = listening.join().unwrap();
    assert!(datagrams.len() > 15, "{} datagrams", datagrams.len());
    for mut datagram in datagrams {
        assert_eq!(datagram.remove("timestamp"), Some(datagram["time_s"]));
        let row = rows.iter().find(|row| row["time_s"] == datagram["time_s"]);
        assert_eq!(row, Some(&datagram));
    }

    // The earlier record is moved as a whole.
    let plain = ["run", &scenario, "--quiet", "--out", &out_text];
    thermyo(&plain).ok();
    assert!(!out.join("trace.mcap").exists() && out.join("earlier-1/trace.mcap").exists());
}

#[test]
fn an_invalid_address_is_reported_and_nothing_is_written() {
    let folder = Folder::new();
    let scenario = folder.scenario(SCENARIO);
    let out = folder.path("out");
    let out_text = out.display().to_string();
    for (wish, message) in [
        (["--stream", "127.0.0.1:9870"], "must be udp:HOST:PORT"),
        (["--stream", "udp:127.0.0.1:x"], "must be udp:HOST:PORT"),
        (["--stream", "udp:nobody.invalid:9870"], "no host is called so"),
        (["--log", "bag"], "[possible values: mcap]"),
    ] {
        thermyo(&[&["run", &scenario, "--out", &out_text], &wish[..]].concat()).refused(message);
        assert!(!out.exists(), "{wish:?} left something");
    }
}
