//! No case of `corpus/` violates a property, so that faults found once do not come back.

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
