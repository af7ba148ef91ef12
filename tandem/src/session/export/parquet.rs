//! A table as a Parquet file: typed columns that may be empty, some thousand rows together, compressed.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::Result;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use super::row::{Cell, Row};

/// Rows that are compressed together and held in memory until then.
const GROUP: usize = 16_384;

/// Writes the rows, which all have the columns of the first, and says how many they were.
pub(super) fn write(path: &Path, mut rows: impl Iterator<Item = Row>) -> anyhow::Result<u64> {
    let mut group: Vec<Row> = rows.by_ref().take(GROUP).collect();
    let file = File::create(path)?;
    let schema = schema(group.first()).context("the columns cannot be described")?;
    let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
    let mut count = 0;
    while !group.is_empty() {
        count += group.len() as u64;
        let mut to = writer.next_row_group()?;
        write_group(&mut to, &group)?;
        to.close()?;
        group = rows.by_ref().take(GROUP).collect();
    }
    writer.close()?;
    Ok(count)
}

fn schema(first: Option<&Row>) -> Result<TypePtr> {
    let columns = first.into_iter().flat_map(|row| row.names.iter().zip(&row.cells));
    let columns: Result<Vec<TypePtr>> = columns.map(|(name, cell)| column(name, cell).map(Arc::new)).collect();
    let table = Type::group_type_builder("table").with_fields(columns?).build()?;
    Ok(Arc::new(table))
}

fn column(name: &str, cell: &Cell) -> Result<Type> {
    let (physical, logical) = match cell {
        Cell::Count(_) => {
            let unsigned = LogicalType::Integer {
                bit_width: 64,
                is_signed: false,
            };
            (Physical::INT64, Some(unsigned))
        }
        Cell::Number(_) => (Physical::DOUBLE, None),
        Cell::Flag(_) => (Physical::BOOLEAN, None),
        Cell::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
    };
    Type::primitive_type_builder(name, physical)
        .with_repetition(Repetition::OPTIONAL)
        .with_logical_type(logical)
        .build()
}

fn write_group<W: Write + Send>(to: &mut SerializedRowGroupWriter<'_, W>, rows: &[Row]) -> Result<()> {
    let mut index = 0;
    while let Some(mut column) = to.next_column()? {
        let cells = rows.iter().map(|row| row.cells.get(index));
        // A value is there or is not: level 1 or 0.
        let mut levels = Vec::with_capacity(rows.len());
        macro_rules! write {
            ($writer:expr, $kind:path, $value:expr) => {{
                let mut values = Vec::with_capacity(rows.len());
                for cell in cells {
                    let value = match cell {
                        Some($kind(value)) => value.as_ref().map($value),
                        _ => None,
                    };
                    levels.push(i16::from(value.is_some()));
                    values.extend(value);
                }
                $writer.write_batch(&values, Some(&levels), None)?;
            }};
        }
        match column.untyped() {
            // The bits of an unsigned number, as the column's logical type says.
            ColumnWriter::Int64ColumnWriter(writer) => write!(writer, Cell::Count, |value| value.cast_signed()),
            ColumnWriter::DoubleColumnWriter(writer) => write!(writer, Cell::Number, |value| *value),
            ColumnWriter::BoolColumnWriter(writer) => write!(writer, Cell::Flag, |value| *value),
            ColumnWriter::ByteArrayColumnWriter(writer) => {
                write!(writer, Cell::Text, |value| ByteArray::from(value.as_str()));
            }
            _ => {}
        }
        column.close()?;
        index += 1;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::record::RowAccessor as _;

    use super::*;

    fn row(number: u64) -> Row {
        let mut row = Row::default();
        row.count("sequence", u64::MAX - number);
        // The middle one knows nothing.
        let known = number != 1;
        row.number("age_s", known.then_some(0.1 * number as f64));
        row.flag("is_pressed", known);
        row.text("held_because", known.then(|| format!("reason {number}")));
        row
    }

    #[test]
    fn a_table_is_read_back_with_its_types_and_its_holes() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("table.parquet");
        assert_eq!(write(&path, (0..3).map(row)).expect("a table"), 3);
        let reader = SerializedFileReader::new(File::open(&path).expect("the table")).expect("Parquet");
        let rows: Vec<_> = reader
            .get_row_iter(None)
            .expect("rows")
            .map(|row| row.expect("a row"))
            .collect();
        assert_eq!(rows.len(), 3);
        let names: Vec<_> = rows[0].get_column_iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["sequence", "age_s", "is_pressed", "held_because"]);
        assert_eq!(rows[2].get_ulong(0).expect("a count"), u64::MAX - 2);
        assert_eq!(
            rows[2].get_double(1).expect("a number").to_bits(),
            (0.1f64 * 2.0).to_bits()
        );
        assert!(rows[2].get_bool(2).expect("a flag"));
        assert_eq!(rows[2].get_string(3).expect("a text"), "reason 2");
        assert!(
            rows[1].get_double(1).is_err() && rows[1].get_string(3).is_err(),
            "what is missing is no value"
        );
        assert!(!rows[1].get_bool(2).expect("a flag"));
    }

    #[test]
    fn more_rows_than_a_group_holds_are_all_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("table.parquet");
        let count = GROUP as u64 + 1;
        assert_eq!(write(&path, (0..count).map(row)).expect("a table"), count);
        let reader = SerializedFileReader::new(File::open(&path).expect("the table")).expect("Parquet");
        assert_eq!(reader.metadata().num_row_groups(), 2);
        assert_eq!(reader.metadata().file_metadata().num_rows().cast_unsigned(), count);
    }

    #[test]
    fn a_table_without_rows_is_a_file_that_opens() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("table.parquet");
        assert_eq!(write(&path, std::iter::empty()).expect("a table"), 0);
        let reader = SerializedFileReader::new(File::open(&path).expect("the table")).expect("Parquet");
        assert_eq!(reader.metadata().file_metadata().num_rows(), 0);
    }
}
