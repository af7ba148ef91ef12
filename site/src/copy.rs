//! What one machine of a site needs, and nothing else.

use std::path::Path;

use crate::files::create_folder;
use crate::folder::read;
use crate::{CA_CERTIFICATE, Identity, ROSTER, Site, SiteError, write_public, write_secret};

impl Site {
    /// Copies what the machine of one member needs into a new folder: roster, authority's certificate, its own pair. The
    /// site's own secret stays here.
    ///
    /// # Errors
    /// If anything is in the folder already, or a file cannot be read or written.
    pub fn copy_for(&self, identity: &Identity, folder: &Path) -> Result<(), SiteError> {
        let unwritable = |path: &Path| {
            let path = path.to_owned();
            move |source| SiteError::Unwritable { path, source }
        };
        if std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) || folder.is_file() {
            let path = folder.to_owned();
            return Err(SiteError::Exists { path });
        }
        create_folder(folder).map_err(unwritable(folder))?;
        let name = &identity.member.name;
        for file in [ROSTER.to_owned(), CA_CERTIFICATE.to_owned(), format!("{name}.pem")] {
            let to = folder.join(&file);
            write_public(&to, &read(&self.folder().join(&file))?).map_err(unwritable(&to))?;
        }
        let to = folder.join(format!("{name}.key"));
        write_secret(&to, &read(&identity.key_file)?).map_err(unwritable(&to))
    }
}
