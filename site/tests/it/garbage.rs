//! Files with bytes changed, cut and put in: nothing panics, and nothing that was changed is believed.

use tandem_site::{Authority, Certificate, NewMember, Robots, Role, Roster, Validity, trusts_as_client};

/// Numbers that look drawn, the same ones at every run.
struct Chance(u64);

impl Chance {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(self.0 >> 33).expect("31 bits fit") % limit.max(1)
    }

    fn spoil(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut spoilt = bytes.to_vec();
        for _ in 0..=self.below(4) {
            let (at, byte) = (self.below(spoilt.len()), self.below(256));
            let byte = u8::try_from(byte).expect("below 256");
            match self.below(4) {
                0 => spoilt.truncate(at),
                1 => spoilt.insert(at, byte),
                _ if spoilt.is_empty() => {}
                2 => spoilt[at] = byte,
                _ => drop(spoilt.remove(at)),
            }
        }
        spoilt
    }
}

#[test]
fn a_spoilt_roster_or_certificate_is_refused_and_never_a_panic() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut authority = Authority::new(&folder.path().join("lab"), "lab".parse().expect("a name")).expect("a site");
    let new = NewMember {
        name: "desk".parse().expect("a name"),
        role: Role::Operator,
        robots: Robots::All,
        hosts: vec![],
        validity: Validity::days(1),
    };
    authority.issue(new).expect("a certificate");
    let site = authority.site();
    let identity = site.identity("desk", None).expect("whole");
    let ca = site.ca_pem().expect("there");
    let der = identity.certificate.der.as_ref();
    let pem = std::fs::read(&identity.certificate_file).expect("there");
    let roster = site.roster().to_toml();
    let mut chance = Chance(1);
    for _ in 0..20_000 {
        let spoilt = chance.spoil(roster.as_bytes());
        if let Ok(text) = std::str::from_utf8(&spoilt)
            && let Ok(read) = Roster::parse(text)
        {
            // Whatever it says now, it can be written and read again.
            assert_eq!(Roster::parse(&read.to_toml()), Ok(read));
        }
        let _ = Certificate::from_pem(&chance.spoil(&pem));
        let spoilt = chance.spoil(der);
        if spoilt != der
            && let Some(read) = Certificate::from_der(&spoilt.as_slice().into())
        {
            // What stands behind the signature is nobody's word.
            let signed = read.der.len().min(der.len());
            assert!(
                trusts_as_client(ca.as_bytes(), &read.der).is_err() || read.der[..signed] == der[..signed],
                "a changed certificate is not believed"
            );
        }
    }
}
