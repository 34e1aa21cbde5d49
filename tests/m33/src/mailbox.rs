//! Mailbox between test and guest: a static of the guest, which the test finds by its symbol.

/// Bytes of the link, one exchange at a time.
#[repr(C)]
pub struct Mailbox {
    /// Owner of the turn; zero until the guest has started.
    pub turn: u32,
    /// Cycles of the last [`step`](model_core::Core::step).
    pub step_cycles: u32,
    pub length: u32,
    /// The request during the guest's turn, then its answer.
    pub bytes: [u8; thermyo_protocol::MAX_FRAME],
}

/// Turn of the test: the guest waits for a request.
pub const TEST: u32 = 1;
/// Turn of the guest: there is a request.
pub const GUEST: u32 = 2;
/// State after a panic of the guest.
pub const PANICKED: u32 = 3;
