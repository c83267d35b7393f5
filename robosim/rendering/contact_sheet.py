"""Contact sheets: pictures with captions in one PNG file."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from robosim.rendering.video import partial_path

Frame = NDArray[np.uint8]
"""Picture (height, width, 3), RGB."""
SHEET_COLUMNS = 3
PICTURE_WIDTH = 640
"""Width [pixels] of one picture on the sheet."""


def write_contact_sheet(frames: list[Frame], captions: list[str], path: str | Path) -> None:
    """Write one to nine frames (height, width, 3) with captions as one PNG.

    Frames have one size; three are in a row. Raises ValueError for other numbers of frames or captions.
    """
    if not 1 <= len(frames) <= SHEET_COLUMNS**2 or len(captions) != len(frames):
        raise ValueError(
            f"contact sheet: {len(frames)} frames, {len(captions)} captions; accepted: 1 to 9, as many of each"
        )
    height = round(PICTURE_WIDTH * frames[0].shape[0] / frames[0].shape[1])
    rows = -(-len(frames) // SHEET_COLUMNS)
    sheet = Image.new("RGB", (SHEET_COLUMNS * PICTURE_WIDTH, rows * height), "white")
    for k, (frame, caption) in enumerate(zip(frames, captions)):
        picture = Image.fromarray(frame).resize((PICTURE_WIDTH, height), Image.Resampling.LANCZOS)
        write_caption(picture, caption)
        sheet.paste(picture, (k % SHEET_COLUMNS * PICTURE_WIDTH, k // SHEET_COLUMNS * height))
    target = Path(path)
    part = partial_path(target)
    sheet.save(part, format="PNG")
    part.replace(target)


def write_caption(picture: Image.Image, caption: str) -> None:
    """Draw a caption on a dark strip in the picture's lower left corner."""
    font = ImageFont.load_default(size=20)
    draw = ImageDraw.Draw(picture, "RGBA")
    left, top, right, bottom = draw.textbbox((16, picture.height - 40), caption, font=font)
    draw.rectangle((left - 10, top - 8, right + 10, bottom + 8), fill=(20, 22, 26, 190))
    draw.text((16, picture.height - 40), caption, font=font, fill=(255, 255, 255, 255))
