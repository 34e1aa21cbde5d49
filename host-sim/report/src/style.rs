//! The style sheet that every drawing shares.

/// Colours, and how a drawing's parts look.
pub const DRAWING_STYLE: &str = include_str!("drawing.css");
