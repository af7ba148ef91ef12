//! Good texts are read, bad ones are refused with their place and what would have been right.

mod arbiter;

use tandem_settings::{Document, show, show_at};

use crate::arbiter::{ArbiterSettings, KNOWN, Law, TlsSettings, read};

fn refusal(text: &str) -> String {
    read(text).expect_err("the text should be refused").to_string()
}

fn refusal_of_word(key: &str, word: &str) -> String {
    let mut document = Document::default();
    document.set(key, word);
    let refused = document.section::<ArbiterSettings>().map(drop);
    let refused = refused
        .and(document.section::<TlsSettings>().map(drop))
        .and(document.finish(KNOWN));
    refused.expect_err("the word should be refused").to_string()
}

#[test]
fn absent_keys_take_their_defaults() {
    assert_eq!(read(""), Ok(ArbiterSettings::default()));
    assert_eq!(read("[arbiter]\n[link.tls]"), Ok(ArbiterSettings::default()));
}

#[test]
fn a_section_for_one_case_takes_what_it_leaves_out_from_the_one_for_all() {
    let document = Document::parse(
        "tandem.toml",
        "[arbiter]\ntimeout_ms = 250\n[arbiter.left]\nlaw = 'fixed'",
    )
    .unwrap();
    let all: ArbiterSettings = document.section().unwrap();
    let left = document.section_over("arbiter.left", all.clone()).unwrap();
    assert_eq!((left.timeout_ms, left.law), (250.0, Law::Fixed));
    assert_eq!(document.section_over("arbiter.right", all.clone()), Ok(all));
    assert!(document.has_section("arbiter.left") && !document.has_section("arbiter.right"));
    let shown = show_at("arbiter.left", &left);
    assert!(shown.contains("[arbiter.left]\n"), "{shown}");
    let again = Document::parse("shown", &shown).unwrap();
    assert_eq!(again.section_at("arbiter.left"), Ok(left));
}

#[test]
fn present_keys_are_read() {
    let text = "[arbiter]\ntimeout_ms = 250\nlaw = 'fixed'\nstart_m = [0, 1.5, -2]\nlisten = []\nseed = 0x10";
    let expected = ArbiterSettings {
        timeout_ms: 250.0,
        law: Law::Fixed,
        start_m: [0.0, 1.5, -2.0],
        listen: Vec::new(),
        seed: 16,
        ..ArbiterSettings::default()
    };
    assert_eq!(read(text), Ok(expected));
}

#[test]
fn nested_sections_are_read_by_their_dotted_name_however_they_are_written() {
    for text in [
        "[link.tls]\nauthority = 'us'",
        "[link]\ntls = { authority = 'us' }",
        "link.tls.authority = 'us'",
    ] {
        let document = Document::parse("tandem.toml", text).expect("the text is TOML");
        let tls = document.section::<TlsSettings>();
        assert_eq!(
            tls,
            Ok(TlsSettings {
                authority: "us".to_owned()
            })
        );
        assert_eq!(document.finish(KNOWN), Ok(()));
    }
}

#[test]
fn the_print_names_meaning_range_default_and_value() {
    let changed = ArbiterSettings {
        timeout_ms: 250.0,
        law: Law::Fixed,
        ..ArbiterSettings::default()
    };
    let expected = r#"# What the arbiter may do.
#
# One of these per arm.
[arbiter]

# How long a command stream may be silent before motion stops, in milliseconds.
# allowed: 20 to 2000; default: 100.0
timeout_ms = 250.0

# How fast the past is forgotten, unitless.
# allowed: above 0, at most 1
leak = 0.3

# A number without limits.
offset = -0.0

# The sharing law.
# allowed: "adaptive", "fixed"; default: "adaptive"
law = "fixed"

# Whether to record.
record = true

# What to call the session.
label = ""

# Where the tool starts, in metres.
# allowed: each -2 to 2
start_m = [0.5, -0.3, 0.15]

# What the weights are drawn from.
seed = 1

# How many units the reservoir has.
# allowed: at least 1
units = 300

# The port.
port = 7447

# Addresses to listen on.
listen = ["tcp/[::]:7447"]

# Laws to compare.
# allowed: each "adaptive", "fixed"
laws = []
"#;
    assert_eq!(show(&changed), expected);
}

#[test]
fn an_unknown_key_is_named_with_its_place_and_the_nearest_known_one() {
    assert_eq!(
        refusal("[link.tls]\n\n authorty = 'us'"),
        "tandem.toml:3:2: unknown key link.tls.authorty (did you mean authority?); known: authority"
    );
    assert_eq!(
        refusal("[link.tls]\ncolour = 'red'"),
        "tandem.toml:2:1: unknown key link.tls.colour; known: authority"
    );
}

#[test]
fn an_unknown_section_is_named_with_its_place_and_the_nearest_known_one() {
    assert_eq!(
        refusal("[arbitre]\nlaw = 'fixed'"),
        "tandem.toml:1:2: unknown section arbitre (did you mean arbiter?); known: arbiter, link.tls"
    );
    assert_eq!(
        refusal("['link.tls']"),
        "tandem.toml:1:2: unknown section \"link.tls\" (did you mean link.tls?); known: arbiter, link.tls"
    );
}

#[test]
fn a_key_outside_of_every_section_is_unknown() {
    assert_eq!(
        refusal("law = 'fixed'"),
        "tandem.toml:1:1: unknown key law; known: arbiter, link.tls"
    );
    assert_eq!(
        refusal("[link]\nmtu = 9"),
        "tandem.toml:2:1: unknown key link.mtu; known: arbiter, link.tls"
    );
}

#[test]
fn of_several_strays_the_first_in_the_file_is_named() {
    assert!(refusal("[arbiter]\nzeal = 1\nease = 2").starts_with("tandem.toml:2:1: unknown key arbiter.zeal"));
    assert!(refusal("[zeal]\n[ease]").starts_with("tandem.toml:1:2: unknown section zeal"));
}

#[test]
fn a_value_of_the_wrong_kind_is_refused_where_it_stands() {
    for (line, complaint) in [
        (
            "timeout_ms = '5'",
            "2:14: arbiter.timeout_ms should be a number, found a string",
        ),
        (
            "seed = 1.0",
            "2:8: arbiter.seed should be a whole number, found a number",
        ),
        (
            "seed = 9223372036854775808",
            "2:8: arbiter.seed should be a whole number, found an integer of more than 64 bits",
        ),
        (
            "record = 'yes'",
            "2:10: arbiter.record should be true or false, found a string",
        ),
        ("label = true", "2:9: arbiter.label should be a string, found true"),
        (
            "label = 1979-05-27",
            "2:9: arbiter.label should be a string, found a date or time",
        ),
        (
            "law = 5",
            "2:7: arbiter.law should be one of \"adaptive\", \"fixed\", found a whole number",
        ),
        (
            "start_m = [1, 2]",
            "2:11: arbiter.start_m should be an array of 3, each a number, found an array of 2",
        ),
        (
            "start_m = [1, 2, '3']",
            "2:18: arbiter.start_m[2] should be a number, found a string",
        ),
        (
            "listen = 'tcp/1'",
            "2:10: arbiter.listen should be an array, each a string, found a string",
        ),
        (
            "listen = ['é', {}]",
            "2:16: arbiter.listen[1] should be a string, found a table",
        ),
        (
            "law.name = 'fixed'",
            "2:1: arbiter.law should be one of \"adaptive\", \"fixed\", found a section",
        ),
    ] {
        assert_eq!(
            refusal(&format!("[arbiter]\n{line}")),
            format!("tandem.toml:{complaint}")
        );
    }
    assert_eq!(
        refusal("arbiter = 5"),
        "tandem.toml:1:11: arbiter should be a section, found a whole number"
    );
    assert_eq!(
        refusal("[[arbiter]]"),
        "tandem.toml:1:1: arbiter should be a section, found an array of 1"
    );
}

#[test]
fn a_number_out_of_range_is_refused_with_the_range() {
    for (line, complaint) in [
        (
            "timeout_ms = 5",
            "2:14: arbiter.timeout_ms = 5 is out of range; allowed: 20 to 2000",
        ),
        (
            "leak = 0.0",
            "2:8: arbiter.leak = 0 is out of range; allowed: above 0, at most 1",
        ),
        (
            "start_m = [0, 0, 2.5]",
            "2:18: arbiter.start_m[2] = 2.5 is out of range; allowed: -2 to 2",
        ),
        (
            "seed = -1",
            "2:8: arbiter.seed = -1 is out of range; allowed: 0 to 9223372036854775807",
        ),
        (
            "port = 70_000",
            "2:8: arbiter.port = 70000 is out of range; allowed: 0 to 65535",
        ),
        ("offset = nan", "2:10: arbiter.offset = NaN is not a finite number"),
        (
            "timeout_ms = inf",
            "2:14: arbiter.timeout_ms = inf is not a finite number",
        ),
        ("offset = 1e400", "2:10: arbiter.offset = inf is not a finite number"),
    ] {
        assert_eq!(
            refusal(&format!("[arbiter]\n{line}")),
            format!("tandem.toml:{complaint}")
        );
    }
}

#[test]
fn a_name_that_is_no_choice_is_refused_with_the_choices() {
    assert_eq!(
        refusal("[arbiter]\nlaw = 'fixd'"),
        "tandem.toml:2:7: arbiter.law = \"fixd\" is not a choice (did you mean fixed?); allowed: adaptive, fixed"
    );
}

#[test]
fn a_text_that_is_not_toml_is_refused_where_it_goes_wrong() {
    assert!(refusal("[arbiter]\nlaw = adaptive").starts_with("tandem.toml:2:7: string values must be quoted"));
    assert_eq!(
        refusal("[arbiter]\nseed = 1\nseed = 2"),
        "tandem.toml:3:1: duplicate key"
    );
}

#[test]
fn the_command_line_overrides_the_file_and_needs_no_quotes() {
    let mut document = Document::parse("tandem.toml", "[arbiter]\nlaw = 'adaptive'").expect("the text is TOML");
    document.set("arbiter.law", "fixed");
    document.set("arbiter.label", "7");
    document.set("arbiter.timeout_ms", "30");
    document.set("arbiter.start_m", "[0, 0, 1]");
    document.set("link.tls.authority", "C:\\us");
    let arbiter: ArbiterSettings = document.section().expect("the words are allowed");
    let tls: TlsSettings = document.section().expect("the word is allowed");
    assert_eq!(
        (arbiter.law, arbiter.label.as_str(), arbiter.timeout_ms),
        (Law::Fixed, "7", 30.0)
    );
    assert_eq!((arbiter.start_m, tls.authority.as_str()), ([0.0, 0.0, 1.0], "C:\\us"));
    assert_eq!(document.finish(KNOWN), Ok(()));
}

#[test]
fn the_command_line_goes_through_the_same_checks() {
    for (key, word, complaint) in [
        (
            "arbiter.timeout_ms",
            "5",
            "arbiter.timeout_ms = 5 is out of range; allowed: 20 to 2000",
        ),
        (
            "arbiter.timeout_ms",
            "soon",
            "arbiter.timeout_ms should be a number, found a string",
        ),
        (
            "arbiter.timeout_ms",
            "30 40",
            "arbiter.timeout_ms should be a number, found a string",
        ),
        (
            "arbiter.start_m",
            "[0, 0, 9]",
            "arbiter.start_m[2] = 9 is out of range; allowed: -2 to 2",
        ),
        (
            "link.tls.athority",
            "us",
            "unknown key link.tls.athority (did you mean authority?); known: authority",
        ),
        (
            "arbitre.seed",
            "5",
            "unknown section arbitre (did you mean arbiter?); known: arbiter, link.tls",
        ),
        ("seed", "5", "unknown key seed; known: arbiter, link.tls"),
    ] {
        assert_eq!(refusal_of_word(key, word), format!("command line: {complaint}"));
    }
}
