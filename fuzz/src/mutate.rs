//! Ways to damage bytes.

use crate::chance::Chance;

/// Numbers that are no numbers, and those at the ends, as eight bytes.
const FLOATS: [f64; 8] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN_POSITIVE,
    -0.0,
    1e300,
    5e-324,
];
/// Damaged bytes do not grow beyond this: what is long is refused by its length and teaches nothing.
const LONGEST: usize = 1 << 20;

/// Damages `bytes` a few times; never more than `times`.
pub(crate) fn damage(bytes: &mut Vec<u8>, times: usize, chance: &mut Chance) {
    for _ in 0..=chance.below(times) {
        damage_once(bytes, chance);
    }
}

fn damage_once(bytes: &mut Vec<u8>, chance: &mut Chance) {
    let at = chance.below(bytes.len());
    match chance.below(10) {
        0 => flip(bytes, at, chance),
        1 => overwrite(bytes, at, &[chance.byte()]),
        2 => overwrite(bytes, at, &chance.number().to_le_bytes()),
        3 => overwrite(bytes, at, &chance.number().to_le_bytes()[..4]),
        4 => overwrite(bytes, at, &chance.pick(&FLOATS).to_le_bytes()),
        5 => bytes.truncate(at),
        6 => remove(bytes, at, chance),
        7 => insert(bytes, at, chance),
        8 => repeat(bytes, at, chance),
        _ => {
            let small = chance.byte() % 17;
            let sum = bytes.get(at).copied().unwrap_or(0).wrapping_add(small).wrapping_sub(8);
            overwrite(bytes, at, &[sum]);
        }
    }
}

fn flip(bytes: &mut [u8], at: usize, chance: &mut Chance) {
    if let Some(byte) = bytes.get_mut(at) {
        *byte ^= 1 << chance.below(8);
    }
}

fn overwrite(bytes: &mut [u8], at: usize, with: &[u8]) {
    for (old, new) in bytes.iter_mut().skip(at).zip(with) {
        *old = *new;
    }
}

fn remove(bytes: &mut Vec<u8>, at: usize, chance: &mut Chance) {
    let end = (at + 1 + chance.below(32)).min(bytes.len());
    bytes.drain(at.min(end)..end);
}

fn insert(bytes: &mut Vec<u8>, at: usize, chance: &mut Chance) {
    let new: Vec<u8> = (0..=chance.below(16)).map(|_| chance.byte()).collect();
    if bytes.len() < LONGEST {
        bytes.splice(at..at, new);
    }
}

fn repeat(bytes: &mut Vec<u8>, at: usize, chance: &mut Chance) {
    let end = (at + 1 + chance.below(64)).min(bytes.len());
    if bytes.len() < LONGEST {
        let again = bytes[at.min(end)..end].to_vec();
        bytes.splice(at..at, again);
    }
}
