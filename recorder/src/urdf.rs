//! The arm's real shape: a URDF file and the meshes it names, read once before recording begins.
//!
//! What is taken from it: links, how each hangs on its parent, and what each looks like. The arm's seven joints are
//! the first seven revolute ones, from the root outwards; fingers and whatever else could move stand at zero. Inertias,
//! collision shapes, limits and controllers are not read: the robot knows those itself.
//!
//! `package://NAME/REST` is looked for in every folder above the URDF file, as `NAME/REST` and as `REST`, for outside
//! of ROS there is nobody to ask where a package lies.

mod parse;

use std::path::{Path, PathBuf};

use rerun::components::MediaType;
use tandem_wire::JOINTS;

pub(crate) use parse::{Origin, Quaternion};

/// A URDF file larger than this is something else.
const MAX_BYTES: u64 = 16 << 20;
/// The largest mesh; all of them are kept in memory while recording goes on.
const MAX_MESH_BYTES: u64 = 64 << 20;

/// Why an arm cannot be shown by its URDF file.
#[derive(Debug, thiserror::Error)]
pub enum UrdfError {
    /// The file, or a mesh that it names, cannot be read.
    #[error("{path:?} cannot be read")]
    Unreadable {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// Far larger than such a file can be.
    #[error("{path:?} has {bytes} bytes, which is too much to be shown")]
    TooLarge {
        /// Which file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// It is no XML.
    #[error("{path:?} is no URDF file")]
    Xml {
        /// Which file.
        path: PathBuf,
        /// What is wrong and where.
        source: roxmltree::Error,
    },
    /// It is XML, but describes no robot.
    #[error("{path:?}, line {line}: {what}")]
    Content {
        /// Which file.
        path: PathBuf,
        /// Where.
        line: u32,
        /// What is wrong.
        what: String,
    },
    /// A mesh is nowhere to be found.
    #[error("{path:?} names the mesh {name:?}, which is not there; looked for it at {first:?}")]
    MeshMissing {
        /// The URDF file.
        path: PathBuf,
        /// As it stands there.
        name: String,
        /// The first place it could have been at.
        first: PathBuf,
    },
    /// A mesh in a format that Rerun does not draw.
    #[error("{path:?} is no mesh that can be drawn: use .stl, .dae, .obj, .glb or .gltf")]
    MeshFormat {
        /// The mesh.
        path: PathBuf,
    },
    /// Another arm than ours.
    #[error("{path:?} has {found} revolute joints; the arm has {JOINTS}")]
    Joints {
        /// The URDF file.
        path: PathBuf,
        /// How many were found.
        found: usize,
    },
}

/// An arm as it looks.
#[derive(Clone, Debug, PartialEq)]
pub struct Urdf {
    /// Parents stand before their children.
    pub(crate) links: Vec<Link>,
}

/// A link of it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Link {
    pub(crate) name: String,
    /// How it hangs on which other; `None` for the root.
    pub(crate) parent: Option<Joint>,
    pub(crate) visuals: Vec<Visual>,
}

/// How a link hangs on its parent.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Joint {
    /// An index into the links.
    pub(crate) parent: usize,
    pub(crate) origin: Origin,
    /// Around which axis it turns.
    pub(crate) axis: [f64; 3],
    /// Which of the arm's joints turns it; `None` if nothing does.
    pub(crate) moved_by: Option<usize>,
}

/// Something to be seen.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Visual {
    pub(crate) origin: Origin,
    pub(crate) shape: Shape,
    /// Red, green, blue, alpha, each up to 1.
    pub(crate) colour: Option<[f64; 4]>,
}

/// What a visual is made of; lengths in metres.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Shape {
    Mesh { file: Mesh, scale: [f64; 3] },
    Box { size: [f64; 3] },
    Cylinder { radius: f64, length: f64 },
    Sphere { radius: f64 },
}

/// A mesh's file, read.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Mesh {
    pub(crate) bytes: Vec<u8>,
    pub(crate) format: MediaType,
}

impl Urdf {
    /// Reads the file at `path` and every mesh that it names.
    ///
    /// # Errors
    /// If something cannot be read, is no URDF, or has fewer joints than the arm; with the place.
    pub fn load(path: &Path) -> Result<Self, UrdfError> {
        let text = read(path, MAX_BYTES)?;
        let text = String::from_utf8(text).map_err(|error| UrdfError::Unreadable {
            path: path.to_owned(),
            source: std::io::Error::new(std::io::ErrorKind::InvalidData, error),
        })?;
        let urdf = Self {
            links: parse::links(path, &text)?,
        };
        let moved = urdf.links.iter().filter_map(|link| link.parent.as_ref()?.moved_by);
        match moved.count() {
            JOINTS => Ok(urdf),
            found => Err(UrdfError::Joints {
                path: path.to_owned(),
                found,
            }),
        }
    }
}

fn read(path: &Path, limit: u64) -> Result<Vec<u8>, UrdfError> {
    let unreadable = |source| UrdfError::Unreadable {
        path: path.to_owned(),
        source,
    };
    let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
    if bytes > limit {
        let path = path.to_owned();
        return Err(UrdfError::TooLarge { path, bytes });
    }
    std::fs::read(path).map_err(unreadable)
}

/// Finds and reads the mesh that a URDF file calls `name`.
fn mesh(urdf: &Path, name: &str) -> Result<Mesh, UrdfError> {
    let candidates = candidates(urdf, name);
    let Some(path) = candidates.iter().find(|path| path.is_file()) else {
        return Err(UrdfError::MeshMissing {
            path: urdf.to_owned(),
            name: name.to_owned(),
            first: candidates.into_iter().next().unwrap_or_default(),
        });
    };
    let format = MediaType::guess_from_path(path).filter(|format| DRAWN.contains(&format.as_str()));
    let format = format.ok_or_else(|| UrdfError::MeshFormat { path: path.clone() })?;
    let bytes = read(path, MAX_MESH_BYTES)?;
    Ok(Mesh { bytes, format })
}

/// Formats that Rerun draws.
const DRAWN: [&str; 5] = [
    MediaType::STL,
    MediaType::DAE,
    MediaType::OBJ,
    MediaType::GLB,
    MediaType::GLTF,
];

/// Where a mesh may lie, likeliest first.
fn candidates(urdf: &Path, name: &str) -> Vec<PathBuf> {
    let folder = urdf.parent().unwrap_or(Path::new(""));
    if let Some(rest) = name.strip_prefix("package://") {
        let within = rest.split_once('/').map_or(rest, |(_, within)| within);
        // A relative path is made whole, or the folders above it would end at the working directory.
        let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        let above = folder.ancestors();
        return above
            .flat_map(|folder| [folder.join(rest), folder.join(within)])
            .collect();
    }
    vec![folder.join(name.strip_prefix("file://").unwrap_or(name))]
}
