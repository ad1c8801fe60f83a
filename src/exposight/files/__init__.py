"""Files that are whole or absent: durable writing, locks, documents, headers, kept pieces."""

from exposight.files.columns import check_columns, unit_hint
from exposight.files.documents import (
    DocumentFormat,
    StoredAs,
    alike,
    check_header,
    parse_json,
    sha256_of,
    validate,
)
from exposight.files.durable import (
    durable_folder,
    is_unfinished,
    make_folder,
    sweep_unfinished,
    write_durably,
)
from exposight.files.kept import KeptFiles
from exposight.files.lock import WRITER_LOCK, hold_writer_lock
from exposight.files.reading import read_bytes, read_text, read_verified
