//! The messages of the programs that measure a load.

use crate::script::mixture::Mixture;
use tandem_wire::{Stamp, Topic, codec};

#[test]
fn a_mixture_holds_what_was_asked_for_and_numbers_both_streams_without_a_gap() {
    let mut mixture = Mixture::new(30);
    let said: Vec<_> = (0..1000).filter_map(|at| mixture.next(Stamp(at))).collect();
    assert_eq!(said.len(), 300);
    for wanted in [Topic::State, Topic::Setpoint] {
        let of_topic = said.iter().filter(|(topic, _)| *topic == wanted);
        let seqs = of_topic.map(|(_, bytes)| codec::peek(bytes).expect("a header").1.seq.0);
        assert!(seqs.eq(1..=150), "{wanted}");
    }
    let mut none = Mixture::new(0);
    assert!((0..1000).all(|at| none.next(Stamp(at)).is_none()));
}
