//! Samples from the host, one step for each.

use super::Source;
use crate::kind::{Config, Sample};
use crate::shared::Shared;
use embassy_time::{Duration, Instant, with_timeout};

pub struct Host {
    shared: &'static Shared,
    sample: Sample,
}

impl Host {
    pub fn new(shared: &'static Shared) -> Self {
        Self { shared, sample: Sample::default() }
    }
}

impl Source for Host {
    async fn due(&mut self) -> Option<(Instant, u32)> {
        let wait = Duration::from_millis(20);
        self.sample = with_timeout(wait, self.shared.samples.receive()).await.ok()?;
        Some((Instant::now(), 0))
    }

    fn sample(&mut self, _: &Config) -> Sample {
        self.sample
    }
}
