//! Folders of results: one writer at a time, each file whole or absent, and nothing of an earlier result beside a new one.

use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use sha2::{Digest, Sha256};
use tempfile::{NamedTempFile, TempPath};

use super::files::WriteError;
use super::vtk;

/// Files that are being written under temporary names.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A folder that this process alone writes results to, until the value is dropped.
///
/// ```
/// use stickslip::output::folder::ResultFolder;
///
/// let parent = tempfile::tempdir()?;
/// let out = parent.path().join("run");
/// let folder = ResultFolder::take(&out)?;
/// // Another run into the same folder is refused, until this one ends.
/// assert!(ResultFolder::take(&out).is_err());
/// drop(folder);
/// assert!(ResultFolder::take(&out).is_ok());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct ResultFolder {
    path: PathBuf,
    /// The folder itself, locked; the lock ends with the process, however that ends.
    _lock: Option<File>,
}

impl ResultFolder {
    /// Creates a folder if there is none, and takes it.
    ///
    /// # Errors
    /// If the folder cannot be created, or another process is writing into it.
    pub fn take(path: &Path) -> Result<Self, WriteError> {
        let failed = |source| WriteError { path: path.to_owned(), source };
        fs::create_dir_all(path).map_err(failed)?;
        let lock = match File::open(path).map(|folder| folder.try_lock().map(|()| folder)) {
            Ok(Ok(folder)) => Some(folder),
            Ok(Err(TryLockError::WouldBlock)) => {
                let busy = "another process is writing results into it: wait until it ends, or write elsewhere";
                return Err(failed(io::Error::new(io::ErrorKind::ResourceBusy, busy)));
            }
            // Some systems cannot open a folder as a file, and some file systems have no locks.
            Ok(Err(TryLockError::Error(_))) | Err(_) => None,
        };
        Ok(Self { path: path.to_owned(), _lock: lock })
    }

    /// Returns the path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Removes files of an earlier result, in the given order. The file that concludes a result comes first, so that a
    /// result without it is known to be incomplete.
    ///
    /// # Errors
    /// If a file is there and cannot be removed.
    pub fn clear(&self, names: &[&str]) -> Result<(), WriteError> {
        names.iter().map(|name| self.path.join(name)).try_for_each(remove)
    }

    /// Removes the frames of an earlier run, and their folder unless something else is in it.
    ///
    /// # Errors
    /// If a frame cannot be removed.
    pub fn clear_frames(&self) -> Result<(), WriteError> {
        self.clear(&["network.pvd", "instrument.pvd"])?;
        let folder = self.path.join(vtk::FRAMES);
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            if vtk::is_frame(&entry.file_name().to_string_lossy()) {
                remove(entry.path())?;
            }
        }
        // The folder stays if it holds anything else.
        let _ = fs::remove_dir(folder);
        Ok(())
    }
}

/// Returns the SHA-256 of a file's bytes, in hexadecimal.
///
/// # Errors
/// If the file cannot be read.
pub fn sha256(path: &Path) -> io::Result<String> {
    let (mut file, mut hash, mut chunk) = (File::open(path)?, Sha256::new(), vec![0; 1 << 16]);
    loop {
        match file.read(&mut chunk)? {
            0 => break,
            read => hash.update(&chunk[..read]),
        }
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Removes a file, if there is one.
fn remove(path: PathBuf) -> Result<(), WriteError> {
    match fs::remove_file(&path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => Err(WriteError { path, source }),
        _ => Ok(()),
    }
}

/// A file that appears under its name only when it is complete. If it is dropped before [`finish`](Self::finish), nothing
/// of it is left.
#[derive(Debug)]
pub struct WholeFile {
    file: File,
    unfinished: TempPath,
    path: PathBuf,
}

impl WholeFile {
    /// Opens a file under a temporary name, with the permissions that the process gives new files.
    ///
    /// # Errors
    /// If its folder cannot be written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let (file, unfinished) = NamedTempFile::into_parts(builder.tempfile_in(folder)?);
        unfinished_files().push(unfinished.to_path_buf());
        Ok(Self { file, unfinished, path: path.to_owned() })
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// If it cannot be renamed.
    pub fn finish(self) -> io::Result<()> {
        let temporary = self.unfinished.to_path_buf();
        self.unfinished.persist(&self.path).map_err(|error| error.error)?;
        unfinished_files().retain(|path| *path != temporary);
        Ok(())
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

fn unfinished_files() -> std::sync::MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes the files that are being written, before a signal ends the process.
pub fn remove_unfinished() {
    for path in unfinished_files().drain(..) {
        // A file that cannot be removed stays: the process is about to end.
        let _ = fs::remove_file(path);
    }
}
