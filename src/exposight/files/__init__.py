"""Files that are whole or absent: durable writing, locks, documents, headers, kept pieces."""

from exposight.files.archives import (
    MOST_MEMBERS,
    MOST_UNPACKED,
    read_array,
    read_arrays,
    read_members,
)
from exposight.files.documents import (
    Checksum,
    DocumentFormat,
    StoredAs,
    alike,
    check_header,
    is_number,
    parse_json,
    validate,
)
from exposight.files.durable import (
    LARGEST_DOCUMENT,
    LARGEST_FILE,
    WRITER_LOCK,
    KeptFiles,
    durable_folder,
    hold_writer_lock,
    is_unfinished,
    make_folder,
    read_bytes,
    read_text,
    read_verified,
    sha256_of,
    sweep_unfinished,
    write_durably,
)
from exposight.files.foreign import parse_apart, parsing
from exposight.files.foreign_yaml import BaseLoader, SafeLoader, check_yaml
from exposight.files.reading import (
    UNITS_MM,
    UNITS_MS,
    Reading,
    ambiguous,
    collected_remarks,
    current_reading,
    reading_as,
    recognised,
)
from exposight.files.safe_texts import (
    check_plain,
    csv_of,
    csv_pieces,
    guarded,
    spelled,
    unguarded,
    without_guards,
)
from exposight.files.text_tables.columns import (
    Matched,
    Wanted,
    likely_column,
    match_columns,
    remarks_on,
    unit_hint,
)
from exposight.files.text_tables.dialects import TextTable, parse_table, read_table
from exposight.files.toml_documents import parse_toml
