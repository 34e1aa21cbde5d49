//! From raw codes to readings in SI.

pub mod front_end;
