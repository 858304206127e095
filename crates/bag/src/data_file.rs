//! A bag's data file as it can be read without a trace beside it: unpacked or copied to a private place where that is
//! needed.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tempfile::TempDir;

use crate::BagError;

const ZSTD_MARK: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];
const ROS1_MARK: &[u8] = b"#ROSBAG V";
const SQLITE_MARK: &[u8] = b"SQLite format 3\0";

/// How a sqlite3 file is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SqliteMode {
    /// Read only; another program may be writing.
    ReadOnly,
    /// In write-ahead mode but with nothing ahead: opened as immutable, because sqlite would make two files beside it.
    Immutable,
    /// A private copy with the journal of a recorder that was killed, which sqlite works in.
    PrivateCopy,
}

/// Where a data file's bytes are.
#[derive(Clone, Debug)]
pub(crate) struct DataFile {
    /// What the user named, for messages.
    pub(crate) shown: PathBuf,
    /// What is read.
    pub(crate) readable: PathBuf,
    /// How, if it is a sqlite3 file.
    pub(crate) sqlite: Option<SqliteMode>,
    /// Removes the private place when the last reader is gone.
    _private: Option<Arc<TempDir>>,
}

impl DataFile {
    /// Looks at a file, and unpacks or copies it to the folder for temporary files if it cannot be read where it is.
    pub(crate) fn open(path: &Path) -> Result<DataFile, BagError> {
        let mut head = head_of(path)?;
        if head.starts_with(ROS1_MARK) {
            let reason = "this is a ROS 1 bag; convert it first: pip install rosbags, then rosbags-convert --src FILE.bag --dst FOLDER";
            return Err(BagError::bad_file(path, reason));
        }
        let mut readable = path.to_owned();
        let mut private = None;
        if head.starts_with(ZSTD_MARK) {
            let folder = private_folder(path)?;
            readable = folder.path().join("data");
            unpack(path, &readable)?;
            head = head_of(&readable)?;
            private = Some(Arc::new(folder));
        }
        let sqlite = is_sqlite(path, &head).then(|| sqlite_mode(&head));
        let mut file = DataFile { shown: path.to_owned(), readable, sqlite, _private: private };
        if file.sqlite.is_some() && has_journal(path) {
            file.copy_with_journal()?;
        }
        Ok(file)
    }

    fn copy_with_journal(&mut self) -> Result<(), BagError> {
        let folder = private_folder(&self.shown)?;
        let target = folder.path().join("data");
        copy(&self.readable, &target)?;
        for suffix in ["-wal", "-journal"] {
            let journal = beside(&self.shown, suffix);
            if journal.exists() {
                copy(&journal, &beside(&target, suffix))?;
            }
        }
        self.readable = target;
        self.sqlite = Some(SqliteMode::PrivateCopy);
        self._private = Some(Arc::new(folder));
        Ok(())
    }
}

/// Whether a file's name is that of a data file: `.mcap` or `.db3`, or either with `.zstd` or `.zst` behind it.
pub(crate) fn is_data_name(path: &Path) -> bool {
    inner_name(path).extension().is_some_and(|extension| extension == "mcap" || extension == "db3")
}

/// The name without the ending of whole-file compression.
pub(crate) fn inner_name(path: &Path) -> PathBuf {
    let packed = path.extension().is_some_and(|extension| extension == "zstd" || extension == "zst");
    if packed { path.with_extension("") } else { path.to_owned() }
}

fn is_sqlite(path: &Path, head: &[u8]) -> bool {
    head.starts_with(SQLITE_MARK) || inner_name(path).extension().is_some_and(|extension| extension == "db3")
}

/// Bytes 18 and 19 of the file are 2 in write-ahead mode.
fn sqlite_mode(head: &[u8]) -> SqliteMode {
    if head.get(18..20) == Some(&[2, 2]) { SqliteMode::Immutable } else { SqliteMode::ReadOnly }
}

fn has_journal(path: &Path) -> bool {
    ["-wal", "-journal"].iter().any(|suffix| fs::metadata(beside(path, suffix)).is_ok_and(|found| found.len() > 0))
}

fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

fn head_of(path: &Path) -> Result<Vec<u8>, BagError> {
    let mut head = Vec::new();
    let file = File::open(path).map_err(BagError::io(path, "open"))?;
    file.take(100).read_to_end(&mut head).map_err(BagError::io(path, "read"))?;
    Ok(head)
}

fn private_folder(path: &Path) -> Result<TempDir, BagError> {
    let made = tempfile::Builder::new().prefix("tandem-bag-").tempdir();
    made.map_err(BagError::io(path, "make a folder for a private copy"))
}

fn copy(from: &Path, to: &Path) -> Result<(), BagError> {
    let mut source = File::open(from).map_err(BagError::io(from, "open"))?;
    let mut target = File::create(to).map_err(BagError::io(to, "create"))?;
    std::io::copy(&mut source, &mut target).map_err(BagError::io(from, "copy to a private place"))?;
    Ok(())
}

fn unpack(from: &Path, to: &Path) -> Result<(), BagError> {
    let source = File::open(from).map_err(BagError::io(from, "open"))?;
    let mut target = File::create(to).map_err(BagError::io(to, "create"))?;
    let mut decoder = zstd::stream::read::Decoder::new(source).map_err(BagError::io(from, "unpack"))?;
    std::io::copy(&mut decoder, &mut target).map_err(BagError::io(from, "unpack (damaged, or the disk is full)"))?;
    Ok(())
}
