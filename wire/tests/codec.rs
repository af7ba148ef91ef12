//! The byte layout: pinned to golden bytes, total on anything else.

mod samples;

use proptest::prelude::*;
use tandem_wire::codec::{HEADER_BYTES, VERSION};
use tandem_wire::*;

fn bytes_of<M: Message>(body: M) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode(
        &Envelope {
            header: samples::header(),
            body,
        },
        &mut bytes,
    );
    bytes
}

fn hex(bytes: &[u8]) -> String {
    let line = |row: &[u8]| row.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    bytes.chunks(32).map(line).collect::<Vec<_>>().join("\n")
}

/// Every kind of message as bytes, decoded again, and refused when cut short, prolonged or relabelled.
fn check<M: Message + Clone + PartialEq + std::fmt::Debug>(body: M) -> String {
    let bytes = bytes_of(body.clone());
    assert_eq!(
        decode::<M>(&bytes),
        Ok(Envelope {
            header: samples::header(),
            body
        })
    );
    for cut in 0..bytes.len() {
        assert!(
            decode::<M>(&bytes[..cut]).is_err(),
            "{} bytes of {} were accepted",
            cut,
            bytes.len()
        );
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert_eq!(decode::<M>(&longer), Err(Malformed::Trailing(1)));
    let with = |at: usize, value: u8| {
        let mut changed = bytes.clone();
        changed[at] = value;
        decode::<M>(&changed).expect_err("refused")
    };
    assert_eq!(with(0, VERSION + 1), Malformed::Version(VERSION + 1));
    assert_eq!(
        with(1, 99),
        Malformed::Kind {
            expected: M::KIND,
            found: 99
        }
    );
    assert_eq!(with(2, 1), Malformed::Body);
    hex(&bytes)
}

#[test]
fn the_layout_is_what_it_was() {
    let golden = [
        ("command", check(samples::command())),
        ("proposal", check(samples::proposal())),
        ("forecast", check(samples::forecast())),
        ("setpoint", check(samples::setpoint())),
        ("state", check(samples::state())),
        ("scene", check(samples::scene())),
        ("trial", check(samples::trial())),
        ("lease", check(samples::claim())),
        ("estop", check(samples::emergency())),
        ("journal", check(samples::journal())),
        ("info", check(samples::info())),
        ("storage", check(samples::storage())),
        ("clock", check(samples::clock())),
        ("ping", check(samples::pong())),
    ];
    let text: String = golden.iter().map(|(name, hex)| format!("{name}\n{hex}\n\n")).collect();
    if text != include_str!("golden.txt") {
        let path = concat!(env!("CARGO_TARGET_TMPDIR"), "/golden.txt");
        std::fs::write(path, text).unwrap();
        panic!("the bytes differ from tests/golden.txt; if that is meant, raise VERSION and take over {path}");
    }
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let command = Command {
            velocity: Vec3::new(0.0, bad, 0.0),
            ..samples::command()
        };
        assert_eq!(decode::<Command>(&bytes_of(command)), Err(Malformed::NotFinite));
        let state = State {
            joints: [Finite(bad); JOINTS],
            ..samples::state()
        };
        assert_eq!(decode::<State>(&bytes_of(state)), Err(Malformed::NotFinite));
    }
}

#[test]
fn a_claim_of_many_elements_reserves_nothing() {
    let mut bytes = bytes_of(samples::scene());
    bytes[HEADER_BYTES..HEADER_BYTES + 8].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(decode::<Scene>(&bytes).is_err());
}

#[test]
fn an_oversized_message_is_not_looked_into() {
    let bytes = vec![VERSION; Command::MAX_BYTES + 1];
    assert_eq!(
        decode::<Command>(&bytes),
        Err(Malformed::Oversized(Command::MAX_BYTES + 1))
    );
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let mut framed = bytes.clone();
        for kind in 0..16 {
            if framed.len() > 4 {
                framed[..4].copy_from_slice(&[VERSION, kind, 0, 0]);
            }
            let _ = decode::<Command>(&framed);
            let _ = decode::<Proposal>(&framed);
            let _ = decode::<Forecast>(&framed);
            let _ = decode::<Setpoint>(&framed);
            let _ = decode::<State>(&framed);
            let _ = decode::<Scene>(&framed);
            let _ = decode::<Trial>(&framed);
            let _ = decode::<Claim>(&framed);
            let _ = decode::<Emergency>(&framed);
            let _ = decode::<JournalBatch>(&framed);
            let _ = decode::<NodeInfo>(&framed);
            let _ = decode::<Storage>(&framed);
            let _ = decode::<ClockReport>(&framed);
            let _ = decode::<Pong>(&framed);
        }
    }

    #[test]
    fn what_is_read_is_written_the_same(at in 0_usize..400, value in any::<u8>()) {
        let mut bytes = bytes_of(samples::setpoint());
        let at = at % bytes.len();
        bytes[at] = value;
        if let Ok(envelope) = decode::<Setpoint>(&bytes) {
            let mut again = Vec::new();
            encode(&envelope, &mut again);
            prop_assert_eq!(again, bytes);
        }
    }
}
