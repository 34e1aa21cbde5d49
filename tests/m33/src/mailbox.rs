//! Mailbox between test and guest: a static of the guest, which the test finds by its symbol.

/// Bytes of the link, one exchange at a time.
#[repr(C)]
pub struct Mailbox {
    /// Whose turn it is; zero until the guest has started.
    pub turn: u32,
    /// Cycles of the last [`step`](model_core::Core::step).
    pub step_cycles: u32,
    pub length: u32,
    /// The request while it is the guest's turn, then its answer.
    pub bytes: [u8; thermyo_protocol::MAX_FRAME],
}

/// The guest waits for a request.
pub const TEST: u32 = 1;
/// A request is there.
pub const GUEST: u32 = 2;
/// The guest has panicked.
pub const PANICKED: u32 = 3;
