//! Every case of `corpus/` holds: what a hunt has found once stays found.

use fuzz::hunt::TARGETS;

#[test]
fn every_case_of_the_corpus_holds() {
    for target in TARGETS {
        let corpus = target.corpus().unwrap();
        assert!(!corpus.is_empty(), "{}", target.name);
        for (file, case) in corpus {
            assert!(case.len() <= 4096, "{}: {} bytes", file.display(), case.len());
            println!("{}", file.display());
            (target.run)(&case);
        }
    }
}
