"""Every table of a folder as Parquet has the rows, columns and values of the same table as CSV."""

import csv
import pathlib
import sys

import pyarrow.parquet

folder = pathlib.Path(sys.argv[1])
tables = sorted(folder.glob("*.parquet"))
assert len(tables) == 6, tables
for table in tables:
    read = pyarrow.parquet.read_table(table)
    columns = read.to_pydict()
    with open(table.with_suffix(".csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == read.num_rows > 0, table
    assert list(rows[0]) == read.column_names, table
    for name, values in columns.items():
        for row, value in zip(rows, values):
            text = row[name]
            if value is None:
                same = text == ""
            elif isinstance(value, bool):
                same = text == str(value).lower()
            elif isinstance(value, float):
                same = float(text) == value
            else:
                same = text == str(value)
            assert same, (table, name, text, value)
    print(table.name, read.num_rows, "rows,", read.num_columns, "columns agree")
