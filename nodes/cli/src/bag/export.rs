//! `tandem bag export`: messages as CSV.

use crate::progress::Progress;
use ::bag::{Value, decode};
use anyhow::{Context, Result, bail};
use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A topic's file while it is written.
struct Table {
    file: BufWriter<std::fs::File>,
    path: PathBuf,
    columns: Columns,
    rows: u64,
}

/// A file that was written.
pub struct Written {
    /// Where.
    pub file: PathBuf,
    /// Lines after the head.
    pub rows: u64,
    /// Columns, the stamp's included.
    pub columns: usize,
}

/// Writes a bag's topics as CSV, one file for each, into a folder that is empty or not there. `topics`: only these;
/// none: all.
pub fn export_csv(
    bag: &Path,
    folder: &Path,
    topics: &[String],
    report: &mut dyn FnMut(Written) -> Result<()>,
) -> Result<()> {
    let bag = super::open(bag)?;
    super::check_topics(&bag, topics)?;
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    if std::fs::read_dir(folder)?.next().is_some() {
        bail!("{} is not empty; nothing was written; choose another folder", folder.display());
    }
    let mut definitions = Vec::new();
    for topic in bag.topics() {
        let wanted = topics.is_empty() || topics.contains(&topic.name);
        definitions.push(match topic.parsed_definition() {
            _ if !wanted => None,
            Ok(definition) => Some(definition),
            // Asked for by name it is an error, else a topic that cannot be written.
            Err(error) if !topics.is_empty() => return Err(error.into()),
            Err(error) => {
                note!("  left out: {error}");
                None
            }
        });
    }
    let progress = Progress::begin("exporting");
    // Once for the columns, because a list may be longer in a later message, and once for the rows.
    let mut columns: BTreeMap<usize, Columns> = BTreeMap::new();
    for message in bag.messages()? {
        let message = message?;
        let Some(definition) = &definitions[message.topic] else { continue };
        let value =
            decode(definition, &message.data).with_context(|| format!("topic {}", bag.topics()[message.topic].name))?;
        columns.entry(message.topic).or_default().take(&value);
    }
    let mut tables: BTreeMap<usize, Table> = BTreeMap::new();
    for (topic, columns) in columns {
        tables.insert(topic, Table::begin(folder, &bag.topics()[topic].name, columns)?);
    }
    for message in bag.messages()? {
        let message = message?;
        let (Some(definition), Some(table)) = (&definitions[message.topic], tables.get_mut(&message.topic)) else {
            continue;
        };
        table.row(message.stamp_ns, &decode(definition, &message.data)?)?;
    }
    drop(progress);
    for table in tables.values_mut() {
        table.file.flush().with_context(|| format!("cannot write {}", table.path.display()))?;
        report(Written { file: table.path.clone(), rows: table.rows, columns: table.columns.0.len() + 1 })?;
    }
    Ok(())
}

/// Names of the columns, in the order of the message's fields.
#[derive(Default)]
struct Columns(Vec<String>);

impl Columns {
    /// Adds what the message has and no one before it had: each after the value that stands before it in the message.
    fn take(&mut self, value: &Value) {
        let mut place = 0;
        value.for_each_leaf(&mut |name, _| {
            // Most messages have the columns that are known, in their order.
            place = match self.0[place..].iter().position(|known| known == name) {
                Some(ahead) => place + ahead + 1,
                None => {
                    self.0.insert(place, name.to_owned());
                    place + 1
                }
            };
        });
    }
}

impl Table {
    fn begin(folder: &Path, topic: &str, columns: Columns) -> Result<Table> {
        let path = folder.join(format!("{}.csv", topic.trim_matches('/').replace('/', "__")));
        let file = std::fs::File::create_new(&path).with_context(|| format!("cannot write {}", path.display()))?;
        let mut table = Table { file: BufWriter::new(file), path, columns, rows: 0 };
        let head: Vec<String> = table.columns.0.iter().map(|name| quoted(name)).collect();
        table.line(&format!("stamp_ns,{}", head.join(",")))?;
        Ok(table)
    }

    /// Columns that this message has no value for stay empty.
    fn row(&mut self, stamp_ns: u64, value: &Value) -> Result<()> {
        let mut line = stamp_ns.to_string();
        let mut place = 0;
        value.for_each_leaf(&mut |name, leaf| {
            while self.columns.0[place] != name {
                line.push(',');
                place += 1;
            }
            line.push(',');
            line.push_str(&cell(leaf));
            place += 1;
        });
        line.extend(std::iter::repeat_n(',', self.columns.0.len() - place));
        self.rows += 1;
        self.line(&line)
    }

    fn line(&mut self, text: &str) -> Result<()> {
        writeln!(self.file, "{text}").with_context(|| format!("cannot write {}", self.path.display()))
    }
}

fn cell(value: &Value) -> String {
    match value {
        Value::Bool(value) => u8::from(*value).to_string(),
        Value::Integer(value) => value.to_string(),
        Value::Unsigned(value) => value.to_string(),
        // The shortest text that reads back as the same number.
        Value::Number(value) => format!("{value:?}"),
        Value::Text(text) => quoted(text),
        Value::List(_) | Value::Fields(_) => String::new(),
    }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_lists_that_grow_keep_the_order_of_the_fields() {
        let list = |values: &[i64]| Value::List(values.iter().map(|value| Value::Integer(*value)).collect());
        let message = |a: &[i64], b: &[i64]| Value::Fields(vec![("a".into(), list(a)), ("b".into(), list(b))]);
        let messages = [message(&[], &[1]), message(&[2, 3], &[4]), message(&[5], &[6, 7]), message(&[], &[])];
        let mut columns = Columns::default();
        messages.iter().for_each(|message| columns.take(message));
        assert_eq!(columns.0, ["a[0]", "a[1]", "b[0]", "b[1]"]);
        let folder = tempfile::tempdir().unwrap();
        let mut table = Table::begin(folder.path(), "/some/topic", columns).unwrap();
        for (stamp, message) in messages.iter().enumerate() {
            table.row(stamp as u64, message).unwrap();
        }
        table.file.flush().unwrap();
        let text = std::fs::read_to_string(folder.path().join("some__topic.csv")).unwrap();
        assert_eq!(text, "stamp_ns,a[0],a[1],b[0],b[1]\n0,,,1,\n1,2,3,4,\n2,5,,6,7\n3,,,,\n");
    }
}
