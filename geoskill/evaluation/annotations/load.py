"""Labeled regions of a recording from a file or a folder, whose content says which program wrote it."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from geoskill.errors import InputError
from geoskill.evaluation.annotations.assignment import RoleNames, assigned_regions
from geoskill.evaluation.annotations.coco import coco_pictures
from geoskill.evaluation.annotations.cvat import cvat_pictures
from geoskill.evaluation.annotations.labelme import labelme_picture
from geoskill.evaluation.annotations.masks import mask_files, masked_pictures
from geoskill.evaluation.annotations.own_format import own_regions
from geoskill.evaluation.annotations.picture import LabeledPicture
from geoskill.evaluation.regions import Regions
from geoskill.io.text_file import parse_json, read_text

EXPECTED = "a regions file (JSON)"
COCO = {"images", "annotations", "categories"}


def load_regions(
    path: str | Path,
    image_size: tuple[int, int] | None = None,
    frame_count: int | None = None,
    names: RoleNames | None = None,
    stems: Sequence[str] | None = None,
) -> Regions:
    """Read labeled regions and check them against their recording.

    Args:
        path: a file of this project's own format, LabelMe, COCO or CVAT; or a folder of LabelMe's files or of masks.
        image_size: width and height of the recording's frames in pixels; None when they are not known yet.
        frame_count: number of its frames; None when it is not known.
        names: labels of the object, the target and the hand; None for these words. Own files have no others.
        stems: names of the recording's pictures without their endings, if it is a folder of pictures.

    Raises:
        InputError: when there is no such file, it has none of these formats, or it does not fit the recording.
    """
    names = RoleNames() if names is None else names
    if Path(path).is_dir():
        regions = assigned_regions(path, _pictures_in(Path(path)), names, frame_count, stems)
    else:
        regions = _regions_of_file(path, names, frame_count, stems)
    if image_size is not None:
        regions.require_size(image_size)
    return regions


def _regions_of_file(
    path: str | Path, names: RoleNames, frame_count: int | None, stems: Sequence[str] | None
) -> Regions:
    text = read_text(path, EXPECTED)
    if text.lstrip().startswith("<"):
        return assigned_regions(path, cvat_pictures(path, text), names, frame_count, stems)
    content = parse_json(path, text, EXPECTED)
    if "shapes" in content:
        return assigned_regions(path, [labelme_picture(path, content)], names, frame_count, stems)
    if content.keys() >= COCO:
        return assigned_regions(path, coco_pictures(path, content), names, frame_count, stems)
    if names != RoleNames():
        raise InputError(
            f"{path}: has no labels of LabelMe, COCO or CVAT; expected no regions.object, regions.target or"
            " regions.hand with this project's own format"
        )
    return own_regions(path, content, frame_count)


def _pictures_in(folder: Path) -> Iterator[LabeledPicture]:
    files = sorted(folder.glob("*.json"))
    if files:
        for file in files:
            content = parse_json(file, read_text(file, EXPECTED), EXPECTED)
            if "shapes" not in content:
                raise InputError(f"{file}: has no shapes; expected files of LabelMe alone in a folder of labels")
            yield labelme_picture(file, content)
    elif mask_files(folder):
        yield from masked_pictures(folder)
    else:
        raise InputError(f"{folder}: holds no labels; expected LabelMe's files (*.json) or masks (*.png)")
