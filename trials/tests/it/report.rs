//! What a report says of runs that are large enough, too small, empty, or hostile.

use tandem_trials::report::{Case, Identity, QUANTITIES, Report, Setup};
use tandem_trials::{Measures, Trace};

/// A trial with this effort at each of its steps, and this weight.
fn case(number: u32, condition: &str, context: &str, group: &str, efforts: &[f64], weight: f64) -> Case {
    let identity = Identity {
        number,
        participant: "P1".into(),
        condition: condition.into(),
        context: context.into(),
        group: group.into(),
        repetition: 1,
        success: true,
        session: "session-1.mcap".into(),
        began_s: 10.0 * f64::from(number),
        ..Identity::default()
    };
    let mut case = Case::new(identity, &Trace::default());
    case.measures = Measures {
        human_effort_mean_m_s: Some(efforts.iter().sum::<f64>() / efforts.len() as f64),
        human_effort_steps_m_s: efforts.to_vec(),
        weight_mean_after: Some(weight),
        min_clearance_m: Some(0.03 + efforts[0]),
        ..Measures::default()
    };
    case.constant_weight = (condition != "adaptive").then_some(weight);
    case.autocorrelation = Some(0.8);
    case
}

/// Ten interpolated and four extrapolated contexts under two conditions, three steps each.
fn paper_like() -> Vec<Case> {
    let mut cases = Vec::new();
    for context in 0..14_u32 {
        let group = if context < 10 { "interpolated" } else { "extrapolated" };
        let base = 0.1 + 0.003 * f64::from(context);
        let gain = if context < 10 {
            0.02 + 0.001 * f64::from(context)
        } else {
            0.001 * f64::from(context % 2)
        };
        let name = format!("c{context}");
        cases.push(case(
            2 * context + 1,
            "fixed",
            &name,
            group,
            &[base, base + 0.01, base - 0.02],
            0.5,
        ));
        let eased = [base - gain, base + 0.01 - gain, base - 0.02 - gain];
        cases.push(case(2 * context + 2, "adaptive", &name, group, &eased, 0.3));
    }
    cases
}

fn report(cases: Vec<Case>) -> Report {
    let setup = Setup {
        title: "paper".into(),
        ..Setup::default()
    };
    Report::new(setup, cases)
}

fn everything(report: &Report) -> String {
    let mut text = report.html() + &report.text();
    text += &serde_json::to_string(report).expect("a report is plain data");
    report.csv().iter().for_each(|table| text += &table.text);
    text
}

#[test]
fn bad_lines_are_told_above_the_figures_and_only_where_there_are_some() {
    let mut report = report(paper_like());
    assert!(!report.html().contains("Bad lines") && !report.text().contains("Bad lines"));
    report.setup.bad_lines = vec![("far".into(), "command 100 ms late".into())];
    assert!(
        report
            .text()
            .contains("Bad lines on purpose:\n  far: command 100 ms late")
    );
    assert!(report.html().contains("<li>far: command 100 ms late</li>"));
}

#[test]
fn groups_are_kept_apart_and_counted_in_trials_and_in_steps() {
    let report = report(paper_like());
    assert_eq!(report.groups, ["interpolated", "extrapolated", "all"]);
    for (group, trials) in [("interpolated", 10), ("extrapolated", 4), ("all", 14)] {
        let summary = report.summary("adaptive", group).expect("it has trials");
        assert_eq!((summary.trials, summary.steps), (trials, 3 * trials));
        let mut comparisons = report.comparisons.iter();
        let effort = comparisons
            .find(|one| one.group == group && one.steps.is_some())
            .expect("effort is compared");
        assert_eq!(
            (effort.first.as_str(), effort.second.as_str(), effort.pairs),
            ("adaptive", "fixed", trials)
        );
        assert_eq!(effort.steps.as_ref().map(|steps| steps.first_steps), Some(3 * trials));
    }
    assert!(
        report
            .text()
            .contains("adaptive N = 30, fixed N = 30 steps from 10 and 10 trials"),
        "{}",
        report.text()
    );
}

#[test]
fn a_difference_in_every_pair_is_found_and_one_of_chance_is_not() {
    let text = report(paper_like()).text();
    let line = |group: &str| {
        text.lines()
            .find(|line| line.contains(&format!("human effort, {group}")))
            .expect("a line")
    };
    assert!(
        line("interpolated").contains("24.5 mm/s less than fixed"),
        "{}",
        line("interpolated")
    );
    assert!(line("interpolated").ends_with("Better."), "{}", line("interpolated"));
    assert!(
        line("extrapolated").contains("chance explains as much"),
        "{}",
        line("extrapolated")
    );
    assert!(
        line("extrapolated").contains("p is at least 0.125"),
        "{}",
        line("extrapolated")
    );
    assert!(text.contains("are not independent"));
}

#[test]
fn only_trials_that_share_participant_context_and_repetition_form_pairs() {
    let mut cases = paper_like();
    cases[1].identity.participant = "P2".into();
    cases[3].identity.repetition = 2;
    cases[5].measures.human_effort_mean_m_s = None;
    let report = report(cases);
    let effort = report
        .comparisons
        .iter()
        .find(|one| one.group == "interpolated")
        .expect("effort comes first");
    assert_eq!((effort.first_trials, effort.second_trials, effort.pairs), (9, 10, 7));
}

#[test]
fn holms_correction_only_raises() {
    let report = report(paper_like());
    for one in &report.comparisons {
        if let (Some(test), Some(corrected)) = (one.permutation.found(), one.holm_p) {
            assert!(corrected >= test.p, "{one:?}");
        }
    }
}

#[test]
fn too_few_trials_are_said_to_be_too_few_and_nothing_is_not_a_number() {
    let mut cases = paper_like();
    cases.truncate(2);
    let mut odd = case(9, "fixed", "elsewhere", "", &[0.1], 0.5);
    odd.measures = Measures::default();
    cases.push(odd);
    let report = report(cases);
    assert!(report.html().contains("too few: 1 of at least 2"));
    assert!(report.text().contains("too few"));
    let all = everything(&report);
    for nonsense in ["NaN", "inf,", ">inf", ":null,\"p\"", "-inf"] {
        assert!(!all.contains(nonsense), "{nonsense}");
    }
}

#[test]
fn a_run_without_trials_says_so() {
    let report = report(Vec::new());
    assert!(report.html().contains("no finished trial"));
    assert!(report.text().starts_with("0 trials"));
    assert!(!everything(&report).contains("NaN"));
}

#[test]
fn one_condition_alone_is_compared_with_nothing() {
    let report = report(
        paper_like()
            .into_iter()
            .filter(|case| case.identity.condition == "fixed")
            .collect(),
    );
    assert!(report.comparisons.is_empty() && report.controls.is_none());
    assert!(report.html().contains("nothing to compare"));
}

#[test]
fn a_law_is_measured_by_the_constants_around_its_own_mean_weight() {
    let mut cases = paper_like();
    for context in 0..14_u32 {
        let group = if context < 10 { "interpolated" } else { "extrapolated" };
        let number = 100 + context;
        cases.push(case(number, "quarter", &format!("c{context}"), group, &[0.05], 0.25));
    }
    let controls = report(cases).controls.expect("two constants");
    assert_eq!(controls.matched, "quarter");
    let fixed = controls.constants[1].2;
    let expected = 0.05 + (0.3 - 0.25) / 0.25 * (fixed - 0.05);
    let found = controls.effort_of_same_weight_m_s.expect("it lies between them");
    assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
}

#[test]
fn the_page_needs_nothing_from_elsewhere_and_trusts_no_text() {
    let mut cases = paper_like();
    cases[0].identity.note = "<script>alert(1)</script> & \"more\"".into();
    cases[1].identity.context = "a\"><img src=x>".into();
    let mut setup = Setup {
        title: "<b>bold</b>".into(),
        ..Setup::default()
    };
    setup.unreadable.push("trial 3: <i>broken</i>".into());
    let page = Report::new(setup, cases).html();
    for hostile in [
        "<script",
        "<img",
        "<b>bold",
        "<i>broken",
        "http:",
        "https:",
        "@import",
        "url(",
    ] {
        assert!(!page.contains(hostile), "{hostile}");
    }
    assert!(page.contains("&lt;script&gt;alert(1)"));
}

#[test]
fn every_trial_has_a_section_that_leads_to_its_instant() {
    let page = report(paper_like()).html();
    for number in 1..=28 {
        assert!(
            page.contains(&format!("id=\"trial-{number}\"")) && page.contains(&format!("href=\"#trial-{number}\""))
        );
        assert!(
            page.contains(&format!("tandem replay session-1.mcap --from {number}0.0<")),
            "{number}"
        );
    }
}

#[test]
fn the_same_trials_give_the_same_bytes() {
    assert_eq!(everything(&report(paper_like())), everything(&report(paper_like())));
}

#[test]
fn tables_have_as_many_cells_in_every_row_and_start_no_formula() {
    let mut cases = paper_like();
    cases[0].identity.note = "=HYPERLINK(\"x\"), and more".into();
    let tables = report(cases).csv();
    assert_eq!(
        tables.iter().map(|table| table.name).collect::<Vec<_>>(),
        ["trials.csv", "steps.csv", "conditions.csv", "comparisons.csv"]
    );
    for table in &tables {
        let cells = |line: &str| {
            let mut quoted = false;
            1 + line
                .chars()
                .filter(|c| {
                    quoted ^= *c == '"';
                    *c == ',' && !quoted
                })
                .count()
        };
        let mut lines = table.text.lines();
        let head = lines.next().expect("a head");
        assert!(lines.clone().count() > 0, "{}", table.name);
        assert!(lines.all(|line| cells(line) == cells(head)), "{}", table.name);
    }
    assert!(
        tables[0].text.contains("\"'=HYPERLINK(\"\"x\"\"), and more\""),
        "{}",
        tables[0].text
    );
}

#[test]
fn quantities_are_shown_with_their_unit_and_an_honest_sign() {
    let effort = &QUANTITIES[0];
    assert_eq!(effort.with_unit(0.1234), "123.4 mm/s");
    assert_eq!(effort.shown(-0.00001), "0.0");
    assert_eq!(effort.shown(-0.0012), "−1.2");
}

#[test]
fn of_many_conditions_each_tells_what_was_found_and_counts_the_rest() {
    let mut cases = paper_like();
    for context in 0..14_u32 {
        let group = if context < 10 { "interpolated" } else { "extrapolated" };
        let base = 0.1 + 0.003 * f64::from(context);
        for (order, condition) in ["human", "robot"].into_iter().enumerate() {
            let number = 29 + 14 * u32::try_from(order).expect("two") + context;
            let efforts = [base, base + 0.01, base - 0.02];
            cases.push(case(number, condition, &format!("c{context}"), group, &efforts, 1.0));
        }
    }
    let text = report(cases).text();
    for condition in ["fixed", "human", "robot"] {
        assert_eq!(
            text.matches(&format!("  adaptive against {condition}:\n")).count(),
            1,
            "{text}"
        );
    }
    assert_eq!(text.matches("comparisons chance explains as much").count(), 3, "{text}");
    let sentences = text.lines().filter(|line| line.contains("after Holm)"));
    assert!(
        sentences.clone().count() > 0 && sentences.clone().all(|line| line.contains("more than chance")),
        "{text}"
    );
}
