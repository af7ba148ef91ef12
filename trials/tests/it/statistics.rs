//! The tests against numbers that others computed. Unless a comment says otherwise they are scipy 1.17.1's.

use serde_json::Value;
use tandem_trials::statistics::{
    Differences, Effect, Unfit, cohen_d, holm, interval, mann_whitney, margin, p_of_t, paired_t, permutation,
    student_t, welch_t, wilcoxon, z_of_u,
};

/// `d = [-3,5,0,2,2,7,-1,9,4,4,6,-2,8,1]`: fourteen pairs with ties and a zero.
const PAIRS: [f64; 14] = [-3.0, 5.0, 0.0, 2.0, 2.0, 7.0, -1.0, 9.0, 4.0, 4.0, 6.0, -2.0, 8.0, 1.0];
/// `e = [-3.5,5,0.5,2,2.5,7,-1,9,4]`: no ties.
const UNTIED: [f64; 9] = [-3.5, 5.0, 0.5, 2.0, 2.5, 7.0, -1.0, 9.0, 4.0];

fn near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-10, "{found} is not {expected}");
}

fn reference() -> Value {
    serde_json::from_str(include_str!("statistics_reference.json")).expect("the reference is JSON")
}

fn samples(reference: &Value, name: &str) -> Vec<f64> {
    let values = reference[name].as_array().expect("samples");
    values.iter().map(|value| value.as_f64().expect("a number")).collect()
}

#[test]
fn the_papers_tests_agree_with_the_reference() {
    let reference = reference();
    let (a, b) = (samples(&reference, "a"), samples(&reference, "b"));
    let expected = |name: &str| reference[name].as_f64().expect("a number");
    let pooled = student_t(&a, &b).expect("enough");
    near(pooled.t, expected("t_pooled"));
    near(pooled.p, expected("p_pooled"));
    let welch = welch_t(&a, &b).expect("enough");
    near(welch.t, expected("t_welch"));
    near(welch.p, expected("p_welch"));
    near(welch.df, expected("df_welch"));
    let corrected = mann_whitney(&a, &b, true).expect("enough");
    near(corrected.u, expected("U_a"));
    near(corrected.p, expected("p_U_continuity"));
    near(
        mann_whitney(&a, &b, false).expect("enough").p,
        expected("p_U_no_continuity"),
    );
    near(cohen_d(&a, &b).expect("enough"), expected("cohen_d"));
}

#[test]
fn the_papers_own_figures_say_which_n_they_come_from() {
    let paper = &reference()["paper"];
    let u = paper["U"].as_f64().expect("a number");
    for (n, name) in [(588.0, "z_if_588"), (1176.0, "z_if_1176")] {
        let z = z_of_u(u, n, n, 0.0, false).expect("no ties");
        near(z, paper[name].as_f64().expect("a number"));
    }
    let p = p_of_t(paper["t"].as_f64().expect("a number"), 1174.0);
    let expected = paper["p_t_df1174"].as_f64().expect("a number");
    assert!((p / expected - 1.0).abs() < 1e-9, "{p} is not {expected}");
}

#[test]
fn far_tails_are_not_rounded_to_zero() {
    let rising = |count: u32, by: f64| -> Vec<f64> { (0..count).map(|k| f64::from(k) + by).collect() };
    // ttest_ind(arange(50.) + 40, arange(50.))
    let test = student_t(&rising(50, 40.0), &rising(50, 0.0)).expect("enough");
    near(test.t, 13.719_886_811_400_706);
    assert!((test.p / 1.529_815_127_152_992_4e-24 - 1.0).abs() < 1e-9, "{}", test.p);
    // mannwhitneyu(arange(300.), arange(300.) + 250, use_continuity=False, method='asymptotic')
    let test = mann_whitney(&rising(300, 0.0), &rising(300, 250.0), false).expect("enough");
    near(test.u, 1250.0);
    assert!((test.p / 2.385_015_040_361_295_4e-94 - 1.0).abs() < 1e-9, "{}", test.p);
}

#[test]
fn ranks_with_ties_agree_with_scipy() {
    // mannwhitneyu([1,2,2,3,4.5,6], [2,3,3,5,7,8,9], use_continuity=True, method='asymptotic')
    let test = mann_whitney(
        &[1.0, 2.0, 2.0, 3.0, 4.5, 6.0],
        &[2.0, 3.0, 3.0, 5.0, 7.0, 8.0, 9.0],
        true,
    );
    let test = test.expect("enough");
    near(test.u, 10.0);
    near(test.p, 0.129_327_214_553_104_25);
    near(test.rank_biserial, 20.0 / 42.0 - 1.0);
}

#[test]
fn the_paired_t_test_agrees_with_scipy() {
    // ttest_1samp(d, 0)
    let test = paired_t(&PAIRS).expect("enough");
    near(test.t, 2.983_651_104_442_923_7);
    near(test.p, 0.010_565_878_620_375_526);
    near(test.df, 13.0);
    let effects = Differences::of(&PAIRS).expect("enough");
    // d.mean() / d.std(ddof=1), and (79.5 - 11.5) / 91 from rankdata(abs(d[d != 0]))
    near(effects.d_z, 0.797_414_299_606_792_4);
    near(effects.rank_biserial, 68.0 / 91.0);
    near(effects.mean, 3.0);
}

#[test]
fn signed_ranks_are_exact_with_and_without_ties() {
    // wilcoxon(d, method=PermutationMethod(n_resamples=inf))
    let tied = wilcoxon(&PAIRS).expect("enough");
    near(tied.w, 11.5);
    near(tied.p, 0.015_136_718_75);
    assert_eq!((tied.n, tied.exact), (13, true));
    // wilcoxon(e, method='exact')
    let untied = wilcoxon(&UNTIED).expect("enough");
    near(untied.w, 7.0);
    near(untied.p, 0.074_218_75);
    // wilcoxon(sin(arange(1, 61) * 1.7) * 10 + 2, method='exact')
    let sixty: Vec<f64> = (1..=60).map(|k| libm::sin(f64::from(k) * 1.7) * 10.0 + 2.0).collect();
    let exact = wilcoxon(&sixty).expect("enough");
    near(exact.w, 608.0);
    near(exact.p, 0.023_290_964_657_690_205);
}

#[test]
fn many_signed_ranks_are_approximated_with_ties() {
    // wilcoxon(round(sin(arange(1, 121) * 1.7) * 10 + 2), method='approx', correction=False): four zeros
    let many: Vec<f64> = (1..=120)
        .map(|k| (libm::sin(f64::from(k) * 1.7) * 10.0 + 2.0).round())
        .collect();
    let test = wilcoxon(&many).expect("enough");
    near(test.w, 2207.5);
    near(test.p, 0.001_077_493_688_761_027_3);
    assert_eq!((test.n, test.exact), (116, false));
}

#[test]
fn permutations_of_few_pairs_are_all_tried() {
    // permutation_test((d,), mean, permutation_type='samples', n_resamples=inf)
    let test = permutation(&PAIRS, 1).expect("enough");
    near(test.p, 0.014_648_437_5);
    assert!(test.exact);
    near(permutation(&UNTIED, 1).expect("enough").p, 0.070_312_5);
}

#[test]
fn permutations_of_many_pairs_are_drawn_from_the_seed() {
    let many: Vec<f64> = (0..28).map(|k| PAIRS[k % 14]).collect();
    let test = permutation(&many, 7).expect("enough");
    assert!(!test.exact);
    assert_eq!(permutation(&many, 7), Ok(test));
    // 400 000 draws of numpy's find 0.00034.
    assert!((0.000_1..0.000_8).contains(&test.p), "{}", test.p);
}

#[test]
fn bootstrap_intervals_agree_with_scipys_up_to_their_draws() {
    // bootstrap((d,), …, n_resamples=200000, method='BCa', random_state=1): mean, and mean over standard deviation
    for (effect, low, high) in [
        (Effect::Mean, 1.071_428_6, 4.928_571_4),
        (Effect::DZ, 0.225_969, 1.425_729_4),
    ] {
        let found = interval(&PAIRS, effect, 3).expect("enough");
        let allowed = 0.04 * (high - low);
        assert!(
            (found.low - low).abs() < allowed && (found.high - high).abs() < allowed,
            "{found:?}"
        );
        assert_eq!(interval(&PAIRS, effect, 3), Ok(found), "the same seed draws the same");
    }
    let ranks = interval(&PAIRS, Effect::RankBiserial, 3).expect("enough");
    assert!(
        ranks.low < ranks.value && ranks.value < ranks.high && ranks.high <= 1.0,
        "{ranks:?}"
    );
}

#[test]
fn holms_correction_goes_step_by_step() {
    let adjusted = holm(&[0.01, 0.04, 0.03, 0.005]);
    let expected = [0.03, 0.06, 0.06, 0.02];
    adjusted
        .iter()
        .zip(expected)
        .for_each(|(found, expected)| near(*found, expected));
    assert_eq!(holm(&[0.9, 0.8]), vec![1.0, 1.0]);
    assert!(holm(&[]).is_empty());
}

#[test]
fn the_margin_of_a_mean_is_students() {
    // t.ppf(0.975, 13) * d.std(ddof=1) / sqrt(14)
    near(margin(&PAIRS).expect("enough"), 2.172_206_381_549_581);
    assert_eq!(margin(&[1.0]), None);
}

#[test]
fn too_few_samples_are_said_to_be_too_few() {
    let too_few = Unfit::TooFew { found: 1, needed: 2 };
    assert_eq!(too_few.to_string(), "too few: 1 of at least 2");
    let few = Err(too_few);
    assert_eq!(student_t(&[1.0], &[1.0, 2.0]).map(|_| ()), few);
    assert_eq!(welch_t(&[1.0, 2.0], &[1.0]).map(|_| ()), few);
    assert_eq!(mann_whitney(&[1.0, 2.0], &[1.0], true).map(|_| ()), few);
    assert_eq!(cohen_d(&[1.0, 2.0], &[1.0]).map(|_| ()), few);
    assert_eq!(paired_t(&[1.0]).map(|_| ()), few);
    assert_eq!(wilcoxon(&[1.0]).map(|_| ()), few);
    assert_eq!(permutation(&[1.0], 1).map(|_| ()), few);
    assert_eq!(Differences::of(&[]), Err(Unfit::TooFew { found: 0, needed: 2 }));
    assert_eq!(
        interval(&[1.0, 2.0], Effect::Mean, 1),
        Err(Unfit::TooFew { found: 2, needed: 3 })
    );
}

#[test]
fn samples_without_spread_and_numbers_that_are_none_give_no_nan() {
    let (same, zeros) = ([0.1; 9], [0.0; 9]);
    assert_eq!(student_t(&same, &same), Err(Unfit::NoSpread));
    assert_eq!(mann_whitney(&same, &same, true), Err(Unfit::NoSpread));
    assert_eq!(paired_t(&same), Err(Unfit::NoSpread));
    assert_eq!(wilcoxon(&zeros), Err(Unfit::NoSpread));
    assert_eq!(permutation(&zeros, 1), Err(Unfit::NoSpread));
    assert_eq!(interval(&same, Effect::Mean, 1), Err(Unfit::NoSpread));
    for bad in [f64::NAN, f64::INFINITY] {
        let with_bad = [1.0, bad, 2.0];
        assert_eq!(student_t(&with_bad, &same), Err(Unfit::NotFinite));
        assert_eq!(mann_whitney(&same, &with_bad, true), Err(Unfit::NotFinite));
        assert_eq!(paired_t(&with_bad), Err(Unfit::NotFinite));
        assert_eq!(permutation(&with_bad, 1), Err(Unfit::NotFinite));
    }
    let huge = student_t(&[1e300, -1e300], &[1.0, 2.0]);
    assert!(huge.is_err() || huge.is_ok_and(|test| test.p.is_finite()), "{huge:?}");
}
