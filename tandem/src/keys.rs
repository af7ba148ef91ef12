//! `tandem keys`: a site's certificates: made, issued, revoked, copied, shown; and what they let each role do.

mod show;

pub(crate) use show::SOON;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::json;
use tandem_link::{LinkError, LinkSettings, Reach};
use tandem_site::{Authority, Member, Name, NewMember, Robots, Role, Site, SiteError, Validity};

use crate::Outcome;

/// How long a certificate holds unless something else is said.
const DAYS: u32 = 365;

#[derive(Subcommand)]
pub(crate) enum KeysCommands {
    /// Makes a site: an authority, and a certificate for each role.
    New(NewFlags),
    /// Issues one more certificate, for another operator, say.
    Issue(IssueFlags),
    /// Takes trust from a certificate, from when whoever listens has the new site.toml.
    Revoke(RevokeFlags),
    /// Copies what one machine needs into a folder of its own.
    Copy(CopyFlags),
    /// Lists the certificates: role, robots, last day, fingerprint, and what is wrong with them.
    Show(ShowFlags),
    /// Prints what Zenoh is told for a role: TLS and access control, as JSON that zenohd takes too.
    Config(ConfigFlags),
}

#[derive(Args)]
pub(crate) struct NewFlags {
    /// What the site is called.
    #[arg(long, value_name = "NAME")]
    site: Name,
    /// The folder to make [default: the site's name].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    certificate: CertificateFlags,
}

/// What a certificate says besides names.
#[derive(Args)]
pub(crate) struct CertificateFlags {
    /// Where those who listen can be reached besides this machine's own loopback: addresses or host names, as they are
    /// dialled. Repeat it for several.
    #[arg(long = "host", value_name = "HOST")]
    hosts: Vec<String>,
    /// How long it holds, in days.
    #[arg(long, default_value_t = DAYS, value_parser = clap::value_parser!(u32).range(1..=3650))]
    days: u32,
}

#[derive(Args)]
pub(crate) struct IssueFlags {
    /// What it may do: operator, predictor, arbiter, robot-sim, recorder, viewer or router.
    role: Role,
    #[command(flatten)]
    site: SiteFlag,
    /// What it is called [default: as its role].
    #[arg(long)]
    name: Option<Name>,
    /// With which robots [default: all of the site's].
    #[arg(long, value_name = "ROBOT,…", value_delimiter = ',')]
    robots: Vec<String>,
    #[command(flatten)]
    certificate: CertificateFlags,
}

/// Where the site is.
#[derive(Args)]
pub(crate) struct SiteFlag {
    /// The site's folder.
    #[arg(long, value_name = "DIR")]
    site: PathBuf,
}

#[derive(Args)]
pub(crate) struct RevokeFlags {
    /// Whose.
    name: String,
    /// Why, in words that its owner will read.
    #[arg(long)]
    why: String,
    #[command(flatten)]
    site: SiteFlag,
}

#[derive(Args)]
pub(crate) struct CopyFlags {
    /// Whose machine.
    name: String,
    /// The folder to make.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    site: SiteFlag,
}

#[derive(Args)]
pub(crate) struct ShowFlags {
    #[command(flatten)]
    site: SiteFlag,
    /// Prints one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(crate) struct ConfigFlags {
    /// The role.
    role: Role,
    #[command(flatten)]
    site: SiteFlag,
    /// Which member, if several have the role here.
    #[arg(long, value_name = "NAME", default_value = "")]
    member: String,
    /// The robot's name, as it stands in the keys.
    #[arg(long, default_value = "panda")]
    robot: String,
    /// Whom to connect to.
    #[arg(long, value_name = "ENDPOINT")]
    connect: Vec<String>,
    /// Where to listen: with it come the rules for everybody who dials.
    #[arg(long, value_name = "ENDPOINT")]
    listen: Vec<String>,
}

pub(crate) fn run(command: &KeysCommands) -> anyhow::Result<Outcome> {
    match command {
        KeysCommands::New(flags) => new(flags)?,
        KeysCommands::Issue(flags) => issue(flags)?,
        KeysCommands::Revoke(flags) => revoke(flags)?,
        KeysCommands::Copy(flags) => copy(flags)?,
        KeysCommands::Show(flags) => return show::run(&flags.site.site, flags.json),
        KeysCommands::Config(flags) => config(flags)?,
    }
    Ok(Outcome::Done)
}

fn new(flags: &NewFlags) -> Result<(), SiteError> {
    let default = PathBuf::from(flags.site.as_str());
    let folder = flags.out.as_ref().unwrap_or(&default);
    let mut authority = Authority::new(folder, flags.site.clone())?;
    for role in Role::ALL {
        let hosts = match role.listens() {
            true => flags.certificate.hosts.clone(),
            false => Vec::new(),
        };
        authority.issue(NewMember {
            name: role
                .as_str()
                .parse()
                .map_err(|why| SiteError::Request(format!("{why}")))?,
            role,
            robots: Robots::All,
            hosts,
            validity: Validity::days(flags.certificate.days),
        })?;
    }
    let shown = folder.display();
    println!(
        "site {} is in {shown}: an authority and {} certificates, good for {} days",
        flags.site,
        Role::ALL.len(),
        flags.certificate.days
    );
    println!("use it on this machine:   tandem robot-sim --site {shown} --listen tcp/127.0.0.1:7447");
    println!("for another machine:      tandem keys copy operator --site {shown} --out operator-laptop");
    println!("keep to yourself:         {shown}/ca.key, with which anybody can issue certificates");
    Ok(())
}

fn issue(flags: &IssueFlags) -> Result<(), SiteError> {
    let mut authority = Authority::open(&flags.site.site)?;
    let bad = |why: tandem_site::BadRoster| SiteError::Request(why.to_string());
    let member = authority.issue(NewMember {
        name: match &flags.name {
            Some(name) => name.clone(),
            None => flags.role.as_str().parse().map_err(bad)?,
        },
        role: flags.role,
        robots: match flags.robots.is_empty() {
            true => Robots::All,
            false => flags.robots.clone().try_into().map_err(bad)?,
        },
        hosts: flags.certificate.hosts.clone(),
        validity: Validity::days(flags.certificate.days),
    })?;
    let Member {
        name,
        role,
        robots,
        expires,
        ..
    } = &member;
    println!("{name} is {role} of {robots} until {expires}: {name}.pem and {name}.key");
    println!(
        "whoever listens has to know: copy {} to it; its connections then begin anew, which stops a robot in motion",
        roster(&flags.site.site)
    );
    Ok(())
}

fn revoke(flags: &RevokeFlags) -> Result<(), SiteError> {
    let mut authority = Authority::open(&flags.site.site)?;
    let member = authority.revoke(&flags.name, &flags.why)?;
    println!("{} ({}) is revoked", member.name, member.common_name);
    println!(
        "it holds where the new {} is: copy it to every machine that listens. Whoever listens there takes it up within \
         seconds: the robot stops, all connections begin anew, and motion needs a running trial and a fresh press",
        roster(&flags.site.site)
    );
    Ok(())
}

fn roster(folder: &Path) -> String {
    folder.join(tandem_site::ROSTER).display().to_string()
}

fn copy(flags: &CopyFlags) -> Result<(), SiteError> {
    let site = Site::open(&flags.site.site)?;
    let identity = site.identity(&flags.name, None)?;
    site.copy_for(&identity, &flags.out)?;
    let (member, shown) = (&identity.member, flags.out.display());
    println!(
        "{shown} holds what the machine of {} needs; its private key is in it, so carry it with care",
        member.name
    );
    println!("there:  tandem {} --site {shown} …", member.role);
    Ok(())
}

fn config(flags: &ConfigFlags) -> Result<(), LinkError> {
    let settings = LinkSettings {
        robot: flags.robot.clone(),
        site: flags.site.site.display().to_string(),
        member: flags.member.clone(),
        listen: flags.listen.clone(),
        connect: flags.connect.clone(),
        ..LinkSettings::default()
    };
    let reach = Reach::new(&settings, Some(flags.role))?;
    println!("{:#}", json!(reach.zenoh()));
    Ok(())
}
