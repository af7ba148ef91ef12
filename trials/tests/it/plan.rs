//! Plans that ship, plans that are wrong, and orders that follow from plan and participant alone.

use std::collections::BTreeSet;

use tandem_trials::plan::{Participant, Plan};

const PAPER: &str = include_str!("../../../examples/plans/paper.toml");
const BEYOND: &str = include_str!("../../../examples/plans/beyond.toml");
const LOSSY: &str = include_str!("../../../examples/plans/lossy.toml");
const SMALL: &str = "[plan]\nparticipants = ['P1', 'P2']\n\
    [conditions]\nfixed = { arbiter.law = 'fixed' }\nadaptive = { arbiter.law = 'adaptive' }\n\
    [contexts]\na = { amplitude_m = 0.1 }\nb = { amplitude_m = 0.12 }\nc = {}\n";

fn participant(code: &str) -> Participant {
    code.parse().expect("a code")
}

fn plan(more: &str) -> Plan {
    Plan::parse("plan.toml", &format!("{SMALL}{more}")).expect("a plan")
}

fn refusal(text: &str) -> String {
    Plan::parse("plan.toml", text)
        .expect_err("it should be refused")
        .to_string()
}

fn pairs(plan: &Plan, code: &str) -> Vec<(usize, usize)> {
    let slots = plan.slots(&participant(code));
    slots.iter().map(|slot| (slot.condition, slot.context)).collect()
}

#[test]
fn the_papers_plan_has_28_trials_ten_contexts_inside_and_four_outside() {
    let plan = Plan::parse("paper.toml", PAPER).expect("it ships");
    assert_eq!(plan.slots(&participant("S1")).len(), 28);
    let groups = |group: &str| {
        let of = plan.contexts.iter();
        of.filter(|context| format!("{:?}", context.settings.group).to_lowercase() == group)
            .count()
    };
    assert_eq!((groups("interpolated"), groups("extrapolated")), (10, 4));
    for context in &plan.contexts {
        plan.check_reach(context).expect("the arm follows every shipped path");
    }
}

#[test]
fn every_condition_of_the_papers_plan_meets_the_same_humans() {
    let plan = Plan::parse("paper.toml", PAPER).expect("it ships");
    let slots = plan.slots(&participant("S1"));
    let seeds = |condition| -> BTreeSet<_> {
        let of = slots.iter().filter(|slot| slot.condition == condition);
        of.map(|slot| (slot.context, slot.seed)).collect()
    };
    assert_eq!(seeds(0), seeds(1));
    assert_eq!(seeds(0).iter().map(|(_, seed)| seed).collect::<BTreeSet<_>>().len(), 14);
    let law = |condition: usize| {
        let configuration = plan.configuration(&plan.conditions[condition], &plan.contexts[0]);
        configuration.expect("it was checked").arbiter.law
    };
    assert_ne!(law(0), law(1));
}

#[test]
fn the_other_plan_sets_departures_only_beyond_the_demonstrations() {
    let plan = Plan::parse("beyond.toml", BEYOND).expect("it ships");
    for context in &plan.contexts {
        let configuration = plan.configuration(&plan.conditions[0], context).expect("checked");
        let beyond = context.settings.group == tandem_trials::plan::Group::Extrapolated;
        assert_eq!(configuration.human.departure_mm, if beyond { 60.0 } else { 0.0 });
        assert_eq!(configuration.human.amplitude_m, context.settings.amplitude_m);
    }
}

#[test]
fn the_lossy_plan_has_a_line_of_its_own_under_each_condition_and_two_laws_on_each() {
    let plan = Plan::parse("lossy.toml", LOSSY).expect("it ships");
    let lines: Vec<String> = plan
        .conditions
        .iter()
        .map(|condition| {
            let configuration = plan.configuration(condition, &plan.contexts[0]).expect("checked");
            configuration.impairment.to_string()
        })
        .collect();
    let late = "command 100 ms late; state-to-operator 100 ms late";
    let lossy = "command 10 % lost; state-to-operator 10 % lost";
    assert_eq!(lines, ["", "", late, late, lossy, lossy]);
    for context in &plan.contexts {
        plan.check_reach(context).expect("the arm follows every shipped path");
    }
}

#[test]
fn a_line_of_a_stream_that_is_none_or_with_a_loss_that_cannot_be_is_refused_with_its_place() {
    let bad = |line: &str| refusal(&format!("{SMALL}[conditions.bad.impairment]\n{line}\n"));
    let said = bad("comand.loss = 0.1");
    assert!(
        said.starts_with("plan.toml:11:") && said.contains("impairment.comand"),
        "{said}"
    );
    let said = bad("command.loss = 1.5");
    assert!(
        said.contains("conditions.bad.impairment.command.loss") && said.contains("0 to 1"),
        "{said}"
    );
    let said = bad("command.delay = 100");
    assert!(said.contains("delay_ms"), "{said}");
}

#[test]
fn a_condition_lays_a_streams_line_over_the_setups() {
    let more = "[setup.impairment]\ndelay_ms = 50\n[setup.impairment.command]\nloss = 0.2\n\
        [conditions.late.impairment.command]\ndelay_ms = 80\n";
    let plan = plan(more);
    let told = |condition: usize| {
        let laid = plan.configuration(&plan.conditions[condition], &plan.contexts[0]);
        laid.expect("checked").impairment.to_string()
    };
    assert_eq!(told(0), "command 50 ms late, 20 % lost");
    assert_eq!(told(2), "command 80 ms late, 20 % lost");
}

#[test]
fn orders_are_the_same_every_time_and_hold_every_pair_once() {
    for order in [
        "",
        "[order]\nconditions = 'random'\ncontexts = 'random'\n",
        "[order]\nconditions='latin-square'\n",
    ] {
        for blocks in ["conditions", "contexts"] {
            let order = if order.is_empty() { "[order]\n" } else { order };
            let plan = plan(&format!("{order}blocks = '{blocks}'\n"));
            let found = pairs(&plan, "P1");
            assert_eq!(found, pairs(&plan, "P1"));
            assert_eq!(found.iter().collect::<BTreeSet<_>>().len(), 6, "{order}: {found:?}");
        }
    }
}

#[test]
fn a_latin_square_turns_the_order_from_participant_to_participant() {
    let plan = plan("[order]\nconditions = 'latin-square'\n");
    assert_eq!(pairs(&plan, "P1")[0].0, 0);
    assert_eq!(pairs(&plan, "P2")[0].0, 1);
}

#[test]
fn practice_comes_first_and_counts_in_no_repetition() {
    let text = SMALL.replace("[plan]", "[plan]\npractice = 4\nrepetitions = 2");
    let plan = Plan::parse("plan.toml", &text).expect("a plan");
    let slots = plan.slots(&participant("P1"));
    assert_eq!(slots.len(), 4 + 12);
    assert!(slots[..4].iter().all(|slot| slot.practice && slot.repetition == 0));
    assert!(slots[4..].iter().all(|slot| !slot.practice && slot.repetition > 0));
    assert!(slots.iter().zip(1..).all(|(slot, number)| slot.number == number));
}

#[test]
fn slips_are_refused_with_place_allowed_values_and_a_guess() {
    for (text, wanted) in [
        (
            "[plan]\nparticpants = []",
            "plan.toml:2:1: unknown key plan.particpants (did you mean participants?)",
        ),
        (
            "[plna]\nname = 'x'",
            "plan.toml:1:2: unknown section plna (did you mean plan?)",
        ),
        (
            "[plan]\nrepetitions = 0",
            "plan.toml:2:15: plan.repetitions = 0 is out of range; allowed: 1 to 1000",
        ),
        ("[order]\nconditions = 'latin'", "is not a choice"),
        (
            "[conditions]\nx = { arbiter.laww = 'fixed' }",
            "plan.toml:2:15: unknown key conditions.x.arbiter.laww (did you mean law?)",
        ),
        (
            "[conditions]\nx = { arbitre.law = 'fixed' }",
            "unknown section arbitre (did you mean arbiter?)",
        ),
        (
            "[conditions]\nx = { arbiter.law = 'fxed' }",
            "(did you mean fixed?); allowed: adaptive, fixed",
        ),
        (
            "[conditions]\nx = 5",
            "plan.toml:2:5: conditions.x should be a section, found a whole number",
        ),
        (
            "[contexts]\nx = { amplitude = 1 }",
            "unknown key contexts.x.amplitude (did you mean amplitude_m?)",
        ),
        ("[contexts.'a b']", "cannot name a context"),
        (
            "[setup.loop]\nseed = 5",
            "plan.toml:2:1: loop.seed cannot be set in a plan: every trial has its own",
        ),
        ("[conditions.x.recorder]\npath = 'y'", "unknown section recorder"),
        (
            "[models.m]\ncheckpoint_step = 4",
            "model m needs either a file or demonstrations",
        ),
        ("[plan", "plan.toml:1:"),
    ] {
        let refused = refusal(text);
        assert!(refused.contains(wanted), "{text}\n  says {refused}\n  not  {wanted}");
    }
}

#[test]
fn what_cannot_be_run_is_refused() {
    let without = |cut: &str| SMALL.replace(cut, "");
    let one = SMALL.replace(
        "adaptive = { arbiter.law = 'adaptive' }\n",
        "[order]\nconditions = 'latin-square'\n",
    );
    for (text, wanted) in [
        (
            without("fixed = { arbiter.law = 'fixed' }\nadaptive = { arbiter.law = 'adaptive' }\n"),
            "there is no condition",
        ),
        (
            without("a = { amplitude_m = 0.1 }\nb = { amplitude_m = 0.12 }\nc = {}\n"),
            "there is no context",
        ),
        (without("participants = ['P1', 'P2']\n"), "plan.participants is empty"),
        (SMALL.replace("'P2'", "'../P2'"), "\"../P2\" is no participant's code"),
        (SMALL.replace("'P2'", "'P1'"), "names P1 twice"),
        (one, "latin-square\" needs at least two conditions, there is 1"),
        (
            SMALL
                .replace("'fixed' }", "'fixed', models = ['nowhere'] }")
                .replace("arbiter.law = 'fixed', models", "models"),
            "condition fixed names the model \"nowhere\"; known: none",
        ),
        (
            SMALL
                .replace("[plan]", "[plan]\nrepetitions = 1000")
                .replace("c = {}", &many(30)),
            "at most 100000 are possible",
        ),
    ] {
        let refused = refusal(&text);
        assert!(refused.contains(wanted), "{refused}\n  not  {wanted}");
    }
}

fn many(contexts: u32) -> String {
    (0..contexts * 2).map(|n| format!("d{n} = {{}}\n")).collect()
}

#[test]
fn a_context_that_the_arm_cannot_follow_is_named_with_its_place() {
    let text = SMALL.replace("b = { amplitude_m = 0.12 }", "b = { amplitude_m = 0.3 }")
        + "[setup.task]\norigin_m = [0.75, -0.3, 0.15]\n[setup.robot-sim]\nstart_m = [0.75, -0.3, 0.15]\n\
           workspace_min_m = [0.0, -0.9, 0.0]\nworkspace_max_m = [1.9, 0.9, 0.9]\n\
           [setup.arbiter]\nworkspace_min_m = [0.0, -0.9, 0.0]\nworkspace_max_m = [1.9, 0.9, 0.9]\n";
    let plan = Plan::parse("plan.toml", &text).expect("each setting is in range");
    let refused = plan.check_reach(&plan.contexts[1]).expect_err("too far").to_string();
    assert!(
        refused.starts_with("plan.toml:8:1: the robot cannot follow context b"),
        "{refused}"
    );
    let high = SMALL.replace("c = {}", "c = { robot-sim.workspace_max_m = [0.8, 0.1, 0.8] }");
    let plan = Plan::parse("plan.toml", &high).expect("each setting is in range");
    let refused = plan.check_reach(&plan.contexts[2]).expect_err("outside").to_string();
    assert!(refused.contains("outside of robot-sim.workspace_min_m"), "{refused}");
}
