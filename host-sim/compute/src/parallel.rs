//! Independent jobs on all cores.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Receives the progress of long work, and ends it early on request.
pub trait Watch: Sync {
    /// Announces `count` more parts.
    fn parts(&self, _count: usize) {}
    fn done(&self) {}
    /// Whether to end early, such as by Ctrl-C: finished parts are kept.
    fn stopped(&self) -> bool {
        false
    }
    /// Largest number of threads: all cores, unless other work must go on meanwhile.
    fn threads(&self) -> usize {
        thread::available_parallelism().map_or(1, usize::from)
    }
}

impl Watch for () {}

/// Results of `work`, in the order of the jobs. Each job is a part; when stopped, no further job
/// begins, and the results are those of the first jobs.
pub fn map_watched<J: Sync, R: Send>(
    jobs: &[J],
    watch: &dyn Watch,
    work: impl Fn(&J) -> R + Sync,
) -> Vec<R> {
    watch.parts(jobs.len());
    let next = AtomicUsize::new(0);
    // Jobs take different times, so each thread takes the next job as soon as it is free.
    let worker = || {
        let mut done = Vec::new();
        while !watch.stopped() {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(index) else { break };
            done.push((index, work(job)));
            watch.done();
        }
        done
    };
    let threads = watch.threads().clamp(1, jobs.len().max(1));
    let mut results: Vec<(usize, R)> = thread::scope(|scope| {
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(worker)).collect();
        let joined = threads.into_iter().map(|thread| thread.join());
        joined.flat_map(|done| done.unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

/// Results of `work`, in the order of the jobs.
pub fn map<J: Sync, R: Send>(jobs: &[J], work: impl Fn(&J) -> R + Sync) -> Vec<R> {
    map_watched(jobs, &(), work)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU64;

    #[derive(Default)]
    struct Counts([AtomicU64; 2]);

    impl Watch for Counts {
        fn parts(&self, count: usize) {
            self.0[0].fetch_add(count as u64, Ordering::Relaxed);
        }

        fn done(&self) {
            self.0[1].fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Stops after this number of parts.
    struct After(AtomicUsize);

    impl Watch for After {
        fn done(&self) {
            self.0.fetch_sub(1, Ordering::Relaxed);
        }

        fn stopped(&self) -> bool {
            self.0.load(Ordering::Relaxed) as isize <= 0
        }
    }

    #[test]
    fn when_stopped_the_first_results_are_kept() {
        let jobs: Vec<usize> = (0..1000).collect();
        let results = map_watched(&jobs, &After(AtomicUsize::new(10)), |job| *job);
        assert!((10..1000).contains(&results.len()), "{}", results.len());
        assert_eq!(results, jobs[..results.len()]);
        assert!(map_watched(&jobs, &After(AtomicUsize::new(0)), |job| *job).is_empty());
    }

    #[test]
    fn every_part_is_counted() {
        let counts = Counts::default();
        map_watched(&[1, 2, 3], &counts, |job| job + 1);
        assert_eq!(counts.0.map(AtomicU64::into_inner), [3, 3]);
    }

    #[test]
    fn every_job_is_done_once_and_in_order() {
        let jobs: Vec<u64> = (0..1000).collect();
        let squares = map(&jobs, |job| job * job);
        assert_eq!(squares, jobs.iter().map(|job| job * job).collect::<Vec<_>>());
        assert!(map(&[], |job: &u64| *job).is_empty());
    }
}
