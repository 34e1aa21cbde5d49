//! tmp
use crate::input::InputError;
use std::path::Path;
/// tmp
#[derive(Debug, Clone)]
pub struct Measured {
    /// t
    pub columns: Vec<Column>,
}
/// tmp
#[derive(Debug, Clone)]
pub struct Column {
    /// t
    pub name: String,
    /// t
    pub points: Vec<(f64, f64)>,
}
impl Measured {
    /// tmp
    pub fn read(path: &Path, _allowed: &[&str]) -> Result<Self, InputError> {
        let mut r = csv::Reader::from_path(path).map_err(|e| InputError(e.to_string()))?;
        let names: Vec<String> = r.headers().unwrap().iter().map(str::to_owned).collect();
        let mut columns: Vec<Column> =
            names.iter().map(|n| Column { name: n.clone(), points: vec![] }).collect();
        for rec in r.records() {
            let rec = rec.unwrap();
            let t: f64 = rec[0].parse().unwrap();
            for (i, c) in rec.iter().enumerate() {
                if let Ok(v) = c.parse() {
                    columns[i].points.push((t, v));
                }
            }
        }
        columns.remove(0);
        Ok(Self { columns })
    }
}
