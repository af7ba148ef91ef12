//! Making a site, and what is refused of one that was copied in part, opened to others, or has grown old.

#![expect(clippy::unwrap_used, reason = "where a helper cannot go on, the test has failed")]

use std::fs;
use std::path::Path;

use tandem_site::{Authority, NewMember, Robots, Role, Site, SiteError, Validity, trusts_as_server};

fn new(name: &str, role: Role) -> NewMember {
    NewMember {
        name: name.parse().unwrap(),
        role,
        robots: Robots::All,
        hosts: vec![],
        validity: Validity::days(30),
    }
}

/// A site "lab" with a robot and an operator.
fn lab(folder: &Path) -> Authority {
    let mut authority = Authority::new(folder, "lab".parse().unwrap()).unwrap();
    authority.issue(new("robot-sim", Role::RobotSim)).unwrap();
    authority.issue(new("desk", Role::Operator)).unwrap();
    authority
}

fn refusal(folder: &Path, name: &str) -> String {
    Site::open(folder)
        .and_then(|site| site.identity(name, None))
        .unwrap_err()
        .to_string()
}

#[test]
fn whoever_was_issued_a_certificate_is_found_by_its_role() {
    let folder = tempfile::tempdir().unwrap();
    let authority = lab(&folder.path().join("lab"));
    let desk = authority.site().identity("", Some(Role::Operator)).unwrap();
    assert_eq!(desk.member.name.as_str(), "desk");
    assert_eq!(desk.certificate.common_name, "lab.desk");
    assert_eq!(desk.certificate.issuer, "Tandem site lab");
    assert!((29..=30).contains(&desk.certificate.days_left()));
    assert!(desk.certificate.hosts.is_empty(), "an operator is dialled by nobody");
    let robot = authority.site().identity("robot-sim", Some(Role::RobotSim)).unwrap();
    assert_eq!(robot.certificate.hosts, ["localhost", "127.0.0.1", "::1"]);
}

#[test]
#[cfg(unix)]
fn private_keys_are_their_owners_alone() {
    use std::os::unix::fs::PermissionsExt as _;
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("lab");
    lab(&site);
    assert_eq!(mode(&site), 0o700);
    for key in ["ca.key", "desk.key", "robot-sim.key"] {
        assert_eq!(mode(&site.join(key)), 0o600, "{key}");
    }
    fs::set_permissions(site.join("desk.key"), fs::Permissions::from_mode(0o640)).unwrap();
    let why = refusal(&site, "desk");
    assert!(why.contains("permissions 0640") && why.contains("chmod 600"), "{why}");
    fs::set_permissions(site.join("ca.key"), fs::Permissions::from_mode(0o604)).unwrap();
    assert!(matches!(
        Authority::open(&site),
        Err(SiteError::OpenKey { mode: 0o604, .. })
    ));
    fs::set_permissions(&site, fs::Permissions::from_mode(0o777)).unwrap();
    assert!(refusal(&site, "robot-sim").contains("chmod 700"));
}

#[test]
fn nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("lab");
    let mut authority = lab(&site);
    let before = fs::read(site.join("desk.key")).unwrap();
    assert!(matches!(
        Authority::new(&site, "lab".parse().unwrap()),
        Err(SiteError::Exists { .. })
    ));
    let why = authority.issue(new("desk", Role::Viewer)).unwrap_err().to_string();
    assert!(why.contains("revoke it first"), "{why}");
    fs::write(site.join("eve.key"), "somebody's").unwrap();
    assert!(matches!(
        authority.issue(new("eve", Role::Viewer)),
        Err(SiteError::Exists { .. })
    ));
    assert_eq!(fs::read(site.join("desk.key")).unwrap(), before);
    assert_eq!(fs::read_to_string(site.join("eve.key")).unwrap(), "somebody's");
}

#[test]
fn a_folder_that_lacks_a_file_is_refused_by_the_files_name() {
    let folder = tempfile::tempdir().unwrap();
    assert!(refusal(&folder.path().join("nowhere"), "").contains("tandem keys new"));
    for lacking in ["site.toml", "ca.pem", "desk.pem", "desk.key"] {
        let site = folder.path().join(lacking);
        lab(&site);
        fs::remove_file(site.join(lacking)).unwrap();
        let why = refusal(&site, "desk");
        assert!(why.contains(lacking) && why.contains("is missing"), "{why}");
    }
}

#[test]
fn a_spoilt_certificate_or_key_is_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("lab");
    let other = folder.path().join("other");
    lab(&site);
    lab(&other);
    let spoil = |file: &str, bytes: &[u8], words: &str| {
        let path = site.join(file);
        let good = fs::read(&path).unwrap();
        fs::write(&path, bytes).unwrap();
        let why = refusal(&site, "desk");
        fs::write(&path, good).unwrap();
        assert!(why.contains(words), "{file}: {why}");
    };
    let cut = fs::read(site.join("desk.pem")).unwrap();
    spoil("desk.pem", &cut[..cut.len() / 2], "only part of one");
    spoil(
        "desk.pem",
        &fs::read(other.join("desk.pem")).unwrap(),
        "not signed by this site's authority",
    );
    spoil(
        "desk.pem",
        &fs::read(site.join("robot-sim.pem")).unwrap(),
        "does not belong to the certificate",
    );
    spoil(
        "desk.key",
        &fs::read(site.join("robot-sim.key")).unwrap(),
        "does not belong to the certificate",
    );
    spoil("desk.key", b"", "not in PEM, or cut off");
    spoil(
        "ca.pem",
        &fs::read(other.join("ca.pem")).unwrap(),
        "not signed by this site's authority",
    );
    let ours = fs::read_to_string(site.join("site.toml")).unwrap();
    let altered = ours.replace("lab.desk", "lab.dusk");
    spoil(
        "site.toml",
        altered.as_bytes(),
        "not the certificate that site.toml lists",
    );
    assert!(refusal(&site, "nobody").contains("it has robot-sim, desk"));
}

#[test]
fn an_expired_certificate_is_refused_with_its_last_day() {
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("lab");
    let mut authority = lab(&site);
    let old = NewMember {
        validity: Validity::between(1_577_836_800, 1_600_000_000),
        ..new("old", Role::Operator)
    };
    authority.issue(old).unwrap();
    let why = refusal(&site, "old");
    assert!(why.contains("expired on 2020-09-13"), "{why}");
    let early = NewMember {
        validity: Validity::between(4_000_000_000, 4_100_000_000),
        ..new("early", Role::Operator)
    };
    authority.issue(early).unwrap();
    assert!(refusal(&site, "early").contains("not valid yet"));
}

#[test]
fn whoever_was_revoked_hears_why_and_comes_back_under_another_common_name() {
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("lab");
    let mut authority = lab(&site);
    fs::copy(site.join("desk.key"), folder.path().join("desk.key")).unwrap();
    fs::copy(site.join("desk.pem"), folder.path().join("desk.pem")).unwrap();
    authority.revoke("desk", "laptop lost").unwrap();
    assert!(authority.revoke("desk", "again").is_err(), "nobody is revoked twice");
    assert!(authority.site().roster().trusted("desk").is_none());
    let verdict = authority.site().roster().verdict("lab.desk").unwrap_err();
    assert!(
        verdict.contains("revoked on") && verdict.contains("laptop lost"),
        "{verdict}"
    );

    let again = authority.issue(new("desk", Role::Operator)).unwrap();
    assert_eq!(again.common_name, "lab.desk.2");
    assert_eq!(
        authority.site().roster().verdict("lab.desk.2").unwrap(),
        "operator of all robots"
    );
    assert!(authority.site().identity("desk", None).is_ok());
    for file in ["desk.key", "desk.pem"] {
        fs::copy(folder.path().join(file), site.join(file)).unwrap();
    }
    assert!(refusal(&site, "desk").contains("not the certificate that site.toml lists"));
}

#[test]
fn the_wrong_role_and_the_wrong_robot_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut authority = lab(&folder.path().join("lab"));
    let left = NewMember {
        robots: vec!["left".to_owned()].try_into().unwrap(),
        ..new("bench", Role::Operator)
    };
    authority.issue(left).unwrap();
    let site = authority.site();
    let why = site.identity("desk", Some(Role::Arbiter)).unwrap_err().to_string();
    assert!(why.contains("role operator") && why.contains("needs arbiter"), "{why}");
    let why = site.identity("", Some(Role::Arbiter)).unwrap_err().to_string();
    assert!(why.contains("no key of an arbiter"), "{why}");
    let why = site.identity("", Some(Role::Operator)).unwrap_err().to_string();
    assert!(why.contains("desk, bench") && why.contains("--member"), "{why}");
    let bench = site.identity("bench", None).unwrap();
    assert!(bench.serves(&"left".parse().unwrap()).is_ok());
    let why = bench.serves(&"right".parse().unwrap()).unwrap_err().to_string();
    assert!(why.contains("has to do with left, not with right"), "{why}");
}

#[test]
fn only_who_may_listen_passes_for_a_listener_and_only_at_its_hosts() {
    let folder = tempfile::tempdir().unwrap();
    let mut authority = lab(&folder.path().join("lab"));
    let router = NewMember {
        hosts: vec!["192.0.2.7".into(), "edge.example".into()],
        ..new("router", Role::Router)
    };
    authority.issue(router).unwrap();
    let site = authority.site();
    let ca = site.ca_pem().unwrap();
    let says = |name: &str, host: &str| {
        let identity = site.identity(name, None).unwrap();
        trusts_as_server(ca.as_bytes(), &identity.certificate.der, host).map_err(|why| why.to_string())
    };
    for host in ["localhost", "127.0.0.1", "192.0.2.7", "edge.example"] {
        assert_eq!(says("router", host), Ok(()), "{host}");
    }
    assert!(says("router", "192.0.2.8").unwrap_err().contains("--host 192.0.2.8"));
    let why = says("desk", "127.0.0.1").unwrap_err();
    assert!(
        why.contains("does not name") || why.contains("not meant for this use"),
        "{why}"
    );
    let why = authority
        .issue(NewMember {
            hosts: vec!["192.0.2.9".into()],
            ..new("carl", Role::Operator)
        })
        .unwrap_err();
    assert!(why.to_string().contains("leave --host out"), "{why}");
}

#[test]
fn a_copy_for_one_machine_is_whole_and_cannot_issue() {
    let folder = tempfile::tempdir().unwrap();
    let authority = lab(&folder.path().join("lab"));
    let site = authority.site();
    let laptop = folder.path().join("laptop");
    site.copy_for(&site.identity("desk", None).unwrap(), &laptop).unwrap();
    let copied = Site::open(&laptop).unwrap();
    assert_eq!(
        copied
            .identity("", Some(Role::Operator))
            .unwrap()
            .certificate
            .common_name,
        "lab.desk"
    );
    assert!(matches!(Authority::open(&laptop), Err(SiteError::Partial { .. })));
    let why = copied.identity("robot-sim", None).unwrap_err().to_string();
    assert!(why.contains("robot-sim.pem is missing"), "{why}");
    let again = site.copy_for(&site.identity("desk", None).unwrap(), &laptop);
    assert!(matches!(again, Err(SiteError::Exists { .. })));
}
