//! A symbolic link that gives a pseudo terminal a name of the user's choice.

use std::fs;
use std::io;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

/// A symbolic link that is removed at the end.
#[derive(Debug)]
pub struct Link {
    path: PathBuf,
    target: PathBuf,
}

/// Why a link cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// A file or directory that is no link has the name.
    #[error(
        "cannot make the link {path}: something that is no link is there; remove it or choose another path"
    )]
    Taken {
        /// The link's path.
        path: PathBuf,
    },
    /// Another link has the name, and what it points to exists.
    #[error(
        "cannot make the link {path}: it is a link to {target} already, which is in use; remove it or choose another path"
    )]
    InUse {
        /// The link's path.
        path: PathBuf,
        /// Where it points to.
        target: PathBuf,
    },
    /// The directory is missing, or must not be written.
    #[error(
        "cannot make the link {path}: {source}; choose a path in a directory that exists and that you may write"
    )]
    Refused {
        /// The link's path.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl Link {
    /// Makes a link at `path` that points to `target`, in one step that others cannot see half
    /// done. A link that points nowhere, or to `target` already, is taken over.
    ///
    /// # Errors
    ///
    /// Something else has the name, or the directory does not allow it.
    pub fn create(path: &Path, target: &Path) -> Result<Self, LinkError> {
        let refused = |source| LinkError::Refused { path: path.to_owned(), source };
        match fs::symlink_metadata(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(refused(error)),
            Ok(found) if !found.is_symlink() => return Err(LinkError::Taken { path: path.to_owned() }),
            Ok(_) => {
                let old = fs::read_link(path).map_err(refused)?;
                if old != target && fs::metadata(path).is_ok() {
                    return Err(LinkError::InUse { path: path.to_owned(), target: old });
                }
            }
        }
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}.new", std::process::id()));
        let fresh = path.with_file_name(name);
        symlink(target, &fresh).map_err(refused)?;
        if let Err(error) = fs::rename(&fresh, path) {
            // What stands in the way is worth more than a leftover.
            let _ = fs::remove_file(&fresh);
            return Err(refused(error));
        }
        Ok(Self { path: path.to_owned(), target: target.to_owned() })
    }

    /// Where the link is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Link {
    /// Removes the link, if it is still ours.
    fn drop(&mut self) {
        if fs::read_link(&self.path).is_ok_and(|target| target == self.target) {
            // The link may be gone in this very moment; then all is well too.
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_is_made_and_removed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("encoder");
        let link = Link::create(&path, Path::new("/dev/null")).unwrap();
        assert_eq!(fs::read_link(link.path()).unwrap(), Path::new("/dev/null"));
        drop(link);
        assert!(fs::symlink_metadata(&path).is_err());
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_link_to_nowhere_is_taken_over() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("encoder");
        symlink(directory.path().join("gone"), &path).unwrap();
        let link = Link::create(&path, Path::new("/dev/null")).unwrap();
        assert_eq!(fs::read_link(link.path()).unwrap(), Path::new("/dev/null"));
    }

    #[test]
    fn a_link_that_points_to_the_target_is_taken_over() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("encoder");
        symlink("/dev/null", &path).unwrap();
        drop(Link::create(&path, Path::new("/dev/null")).unwrap());
        assert!(fs::symlink_metadata(&path).is_err());
    }

    #[test]
    fn what_is_in_the_way_stays_and_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("file");
        fs::write(&file, "precious").unwrap();
        let error = Link::create(&file, Path::new("/dev/null")).unwrap_err().to_string();
        assert!(error.contains("file: something that is no link is there"), "{error}");
        assert_eq!(fs::read(&file).unwrap(), b"precious");

        let used = directory.path().join("used");
        symlink("/dev/zero", &used).unwrap();
        let error = Link::create(&used, Path::new("/dev/null")).unwrap_err().to_string();
        assert!(error.contains("a link to /dev/zero already"), "{error}");
        assert_eq!(fs::read_link(&used).unwrap(), Path::new("/dev/zero"));

        let nowhere = directory.path().join("no/such/place");
        let error = Link::create(&nowhere, Path::new("/dev/null")).unwrap_err().to_string();
        assert!(error.contains("choose a path in a directory that exists"), "{error}");
        assert!(matches!(
            Link::create(directory.path(), Path::new("/dev/null")),
            Err(LinkError::Taken { .. })
        ));
    }

    #[test]
    fn a_link_that_is_no_longer_ours_stays() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("encoder");
        let link = Link::create(&path, Path::new("/dev/null")).unwrap();
        fs::remove_file(&path).unwrap();
        symlink("/dev/zero", &path).unwrap();
        drop(link);
        assert_eq!(fs::read_link(&path).unwrap(), Path::new("/dev/zero"));
    }
}
