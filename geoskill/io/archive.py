"""ZIP archives, as which PyTorch and NumPy store arrays, and which may come from anybody."""

import zipfile


def require_uninflated(archive: zipfile.ZipFile, size: int) -> None:
    """Refuse an archive whose contents take more memory than the file: ours are never compressed.

    Args:
        archive: opened for reading.
        size: of the file in bytes.

    Raises:
        ValueError: when an entry is compressed, or the entries claim to be larger than the file.
    """
    entries = archive.infolist()
    if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
        raise ValueError("an entry is compressed")
    if sum(entry.file_size for entry in entries) > size:
        raise ValueError("the entries are larger than the file")
