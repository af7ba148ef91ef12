//! The model file: what it looks like, that it comes back whole, and that nothing else is taken for one.

#[path = "support/planar.rs"]
mod planar;

use std::sync::LazyLock;

use proptest::prelude::*;
use sha2::{Digest, Sha256};
use tandem_cesn::artefact::{MAGIC, VERSION};
use tandem_cesn::{ArtefactError, Feedback, Model, Settings};

static SMALL: LazyLock<Model> = LazyLock::new(|| {
    let settings = Settings {
        units: 20,
        feedback: Some(Feedback::default()),
        ..Settings::default()
    };
    Model::train(&planar::demonstrations(), &settings).expect("trainable")
});
static BYTES: LazyLock<Vec<u8>> = LazyLock::new(|| SMALL.to_bytes());

/// The file with its hash made right again, so that what lies deeper is looked at.
fn resealed(mut bytes: Vec<u8>, change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let content = bytes.len() - 32;
    change(&mut bytes[..content]);
    let hash = Sha256::digest(&bytes[..content]);
    bytes[content..].copy_from_slice(&hash);
    bytes
}

fn refusal(bytes: &[u8]) -> ArtefactError {
    Model::from_bytes(bytes).expect_err("refused")
}

#[test]
fn the_header_has_its_golden_bytes() {
    let payload = u64::try_from(BYTES.len() - 72).expect("small");
    let mut golden = b"\x89CESN\r\n\x1a".to_vec();
    golden.extend([1, 0, 0, 0, 20, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0, 84, 0, 0, 0, 0, 0, 0, 0]);
    golden.extend(payload.to_le_bytes());
    assert_eq!(BYTES[..40], golden);
    assert_eq!((MAGIC.len(), VERSION), (8, 1));
    assert_eq!(
        BYTES[40..48],
        1_u64.to_le_bytes(),
        "the payload begins with the settings, and they with the seed"
    );
}

#[test]
fn a_model_comes_back_whole_and_forecasts_the_same_bits() {
    let back = Model::from_bytes(&BYTES).expect("whole");
    assert_eq!(back.to_bytes(), *BYTES);
    assert_eq!(back.hash(), SMALL.hash());
    assert_eq!(
        back.hash()[..],
        *Sha256::digest(&*BYTES),
        "what sha256sum says of the file"
    );
    let context = planar::checkpoint(0.1);
    assert_eq!(back.forecast(&context, 42), SMALL.forecast(&context, 42));
    assert_eq!(back.settings(), SMALL.settings());
    assert_eq!(back.provenance(), SMALL.provenance());
    assert_eq!(
        back.provenance().sources[0].sha256,
        planar::demonstration(0.08).sha256()
    );
}

#[test]
fn training_again_gives_the_same_model_and_another_seed_another() {
    let train = |seed| {
        let settings = Settings {
            units: 20,
            seed,
            ..Settings::default()
        };
        Model::train(&planar::demonstrations(), &settings)
            .expect("trainable")
            .hash()
    };
    assert_eq!(train(1), train(1));
    assert_ne!(train(1), train(2));
}

#[test]
fn every_refusal_says_what_was_found() {
    assert_eq!(refusal(b"").to_string(), "this is not a model file: it begins with []");
    assert_eq!(
        refusal(b"\x89CESN\n\n\n more").to_string().split(':').next(),
        Some("this is not a model file")
    );
    assert_eq!(
        refusal(&BYTES[..9]),
        ArtefactError::Truncated { found: 9, expected: 72 }
    );
    let (found, expected) = (BYTES.len() - 1, BYTES.len());
    assert_eq!(refusal(&BYTES[..found]), ArtefactError::Truncated { found, expected });
    let longer = [&BYTES[..], &[0]].concat();
    assert_eq!(
        refusal(&longer),
        ArtefactError::Trailing {
            found: expected + 1,
            expected
        }
    );
    let newer = resealed(BYTES.clone(), |content| content[8] = 9);
    let reason = "the model file has layout version 9; this program reads up to 2; update it, or train again";
    assert_eq!(refusal(&newer).to_string(), reason);
    let huge = resealed(BYTES.clone(), |content| content[39] = 1);
    assert!(matches!(refusal(&huge), ArtefactError::TooLarge { .. }));
    let mut flipped = BYTES.clone();
    flipped[1000] ^= 4;
    assert_eq!(refusal(&flipped), ArtefactError::Damaged);
    let reshaped = resealed(BYTES.clone(), |content| content[12] = 21);
    let reason = "the model file is inconsistent: the header says other shapes than the payload";
    assert_eq!(refusal(&reshaped).to_string(), reason);
}

#[test]
fn numbers_that_are_not_finite_are_refused_even_under_a_right_hash() {
    let nan = f64::NAN.to_le_bytes();
    let weight = SMALL.w_out()[0].to_le_bytes();
    let at = BYTES
        .windows(8)
        .position(|window| window == weight)
        .expect("the readout is in the file");
    let poisoned = resealed(BYTES.clone(), |content| content[at..at + 8].copy_from_slice(&nan));
    let reason = "the model file is inconsistent: the readout holds a number that is not finite";
    assert_eq!(refusal(&poisoned).to_string(), reason);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn no_bytes_make_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(Model::from_bytes(&bytes).is_err());
        let mut begun = BYTES[..40].to_vec();
        begun.extend(&bytes);
        prop_assert!(Model::from_bytes(&begun).is_err());
    }

    #[test]
    fn every_truncation_is_refused(length in 0..BYTES.len()) {
        prop_assert!(Model::from_bytes(&BYTES[..length]).is_err());
    }

    #[test]
    fn every_flipped_bit_is_refused(bit in 0..BYTES.len() * 8) {
        let mut bytes = BYTES.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        prop_assert!(Model::from_bytes(&bytes).is_err());
    }

    /// Someone who can compute a hash may write anything; what is then accepted must still run.
    #[test]
    fn a_forged_payload_is_refused_or_runs(at in 40..BYTES.len() - 40, with in any::<[u8; 8]>(), count in 1..9_usize) {
        let forged = resealed(BYTES.clone(), |content| content[at..at + count].copy_from_slice(&with[..count]));
        if let Ok(model) = Model::from_bytes(&forged) {
            let context = vec![0.2; model.context_columns().len()];
            let _ = model.forecast(&context, model.checkpoint_step() + 1);
            let _ = model.warnings();
        }
    }
}

#[test]
fn models_one_after_the_other_come_back_in_their_order_and_nothing_else_does() {
    let settings = Settings {
        units: 30,
        ..Settings::default()
    };
    let moved: Vec<_> = planar::demonstrations()
        .iter()
        .map(|one| one.conditioned_at(55).expect("84 steps"))
        .collect();
    let other = Model::train(&moved, &settings).expect("trainable");
    let two = [&BYTES[..], &other.to_bytes()].concat();
    let back = Model::several_from_bytes(&two).expect("two models");
    assert_eq!(
        back.iter().map(Model::hash).collect::<Vec<_>>(),
        [SMALL.hash(), other.hash()]
    );
    assert_eq!(Model::several_from_bytes(&BYTES).expect("one model").len(), 1);
    for cut in [0, 1, 39, 40, BYTES.len() - 1, BYTES.len() + 1, two.len() - 1] {
        assert!(Model::several_from_bytes(&two[..cut]).is_err(), "cut at {cut}");
    }
}

#[test]
fn a_demonstration_conditioned_elsewhere_has_its_own_place_there_as_context() {
    let demonstration = &planar::demonstrations()[0];
    let moved = demonstration.conditioned_at(55).expect("84 steps");
    assert_eq!(moved.context(), demonstration.rows().nth(55).expect("84 steps"));
    assert_eq!(moved.context_columns(), ["context_x_m", "context_y_m"]);
    assert!(moved.rows().eq(demonstration.rows()));
    assert_eq!(demonstration.conditioned_at(84), None);
}
