//! The style sheet that every drawing shares.

pub const DRAWING_STYLE: &str = include_str!("drawing.css");
