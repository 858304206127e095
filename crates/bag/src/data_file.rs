//! A bag's data file as it can be read without a trace beside it: unpacked or copied to a private place where that is
//! needed.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tempfile::TempDir;

use crate::BagError;

/// A message of more than this is damage.
const LARGEST_MESSAGE: u64 = 1 << 30;

pub(crate) const ZSTD_MARK: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];
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

    /// The file, opened to be read.
    pub(crate) fn file(&self) -> Result<File, BagError> {
        File::open(&self.readable).map_err(BagError::io(&self.shown, "open"))
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
fn is_data_name(path: &Path) -> bool {
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

/// Bytes 18 and 19 of the file are 1, or 2 in write-ahead mode. sqlite goes by one; damaged they differ.
fn sqlite_mode(head: &[u8]) -> SqliteMode {
    if head.get(18..20) == Some(&[1, 1]) { SqliteMode::ReadOnly } else { SqliteMode::Immutable }
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

/// The file that metadata calls `name`: at the folder's top, packed or unpacked since.
pub(crate) fn listed_file(folder: &Path, name: &str) -> PathBuf {
    let plain = folder.join(Path::new(name).file_name().unwrap_or_default());
    let mut packed = plain.as_os_str().to_owned();
    packed.push(".zstd");
    let candidates = [inner_name(&plain), PathBuf::from(packed)];
    if plain.exists() { plain } else { candidates.into_iter().find(|file| file.exists()).unwrap_or(plain) }
}

/// Why a part of a split bag holds nothing, if it does not.
pub(crate) fn absent(file: &Path) -> Option<&'static str> {
    match std::fs::metadata(file) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Some("this part is missing"),
        Ok(found) if found.len() == 0 => Some("this part is empty"),
        _ => None,
    }
}

/// The `.mcap` and `.db3` files of a folder, in the order of the numbers at the end of their names.
pub(crate) fn data_files(folder: &Path) -> Result<Vec<PathBuf>, BagError> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(BagError::io(folder, "list"))? {
        let path = entry.map_err(BagError::io(folder, "list"))?.path();
        if is_data_name(&path) {
            files.push(path);
        }
    }
    let number = |path: &PathBuf| {
        let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        let digits = stem.rsplit('_').next().and_then(|end| end.parse::<u64>().ok());
        (digits, stem)
    };
    files.sort_by_key(number);
    Ok(files)
}

/// Unpacks one message that rosbag2 compressed by itself.
pub(crate) fn unpack_message(data: &[u8]) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    zstd::stream::read::Decoder::with_buffer(data)
        .and_then(|decoder| decoder.take(LARGEST_MESSAGE).read_to_end(&mut bytes))
        .map_err(|error| format!("cannot be unpacked: {error}"))?;
    Ok(bytes)
}
