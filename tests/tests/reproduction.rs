//! The paper's experiment: golden figures of `thermyo reproduce`, bounded on both sides.

use system_tests::thermyo;

#[test]
fn the_paper_comes_out() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("reproduce");
    let outcome = thermyo(&["reproduce", "--out", &out.display().to_string(), "--json", "--quiet"]);
    assert_eq!(outcome.code, 0, "{}", outcome.err);
    let summary: serde_json::Value = serde_json::from_str(&outcome.out).unwrap();
    let figure =
        |path: &str| path.split('/').fold(&summary, |value, key| &value[key]).as_f64().unwrap();
    for (path, low, high) in [
        ("duration_s", 100.0, 100.0),
        ("strokes", 20.0, 20.0),
        ("sensor_gas_k/first", 297.9, 298.1),
        ("sensor_gas_k/min", 297.9, 298.05),
        ("sensor_gas_k/max", 299.6, 300.1),
        ("sensor_gas_k/last", 298.6, 299.3),
        ("sensor_wall_k/last", 298.2, 298.6),
        ("gas_temperature_k/min", 286.5, 289.5),
        ("gas_temperature_k/max", 309.0, 312.5),
        ("rmse_k/sensor_gas", 8.0, 8.8),
        ("contraction/max", 0.17, 0.2),
        ("pressure_pa/max", 2.45e5, 2.7e5),
    ] {
        let value = figure(path);
        assert!((low..=high).contains(&value), "{path} = {value}, golden {low} to {high}");
    }
    let axial: Vec<f64> = summary["axial_temperature_k"]
        .as_array()
        .unwrap()
        .iter()
        .map(|value| value.as_f64().unwrap() - 273.15)
        .collect();
    assert_eq!(axial.len(), 8);
    assert!(axial[3..].windows(2).all(|pair| pair[0] < pair[1]), "the far half rises: {axial:?}");
    assert!(axial[0] > 24.0 && axial[7] < 30.0 && axial[7] - axial[0] > 1.5, "{axial:?}");
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    for heading in
        ["Fig. 5", "Fig. 2", "Section IV", "Where the heat goes", "(6), (8), (9)", "Not to be had"]
    {
        assert!(page.contains(heading), "{heading} is missing");
    }
    assert_eq!(page.matches("What the paper shows").count(), 6);
    assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
    let mut names: Vec<_> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["report.html", "scenario.toml", "summary.json", "trace.csv"]);
}
