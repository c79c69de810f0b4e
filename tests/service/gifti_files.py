# SPDX-License-Identifier: Apache-2.0
"""GIfTI files by their definition, for tests. Nothing here is hexad's."""
import base64
import zlib

IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
TYPES = {"f4": "NIFTI_TYPE_FLOAT32", "f8": "NIFTI_TYPE_FLOAT64", "i4": "NIFTI_TYPE_INT32", "i8": "NIFTI_TYPE_INT64", "u1": "NIFTI_TYPE_UINT8"}


def array(intent, values, encoding="GZipBase64Binary", big=False, by_column=False, matrix=IDENTITY, name="", **changes):
    order = ">" if big else "<"
    flat = values.flatten(order="F" if by_column else "C")
    data = flat.astype(order + values.dtype.str[1:]).tobytes()
    text = {"ASCII": lambda: " ".join(map(repr, flat.tolist())), "Base64Binary": lambda: base64.b64encode(data).decode(),
            "GZipBase64Binary": lambda: base64.b64encode(zlib.compress(data)).decode(), "ExternalFileBinary": str}[encoding]()
    attributes = {"Intent": f"NIFTI_INTENT_{intent}", "DataType": TYPES[values.dtype.str[1:]],
                  "ArrayIndexingOrder": "ColumnMajorOrder" if by_column else "RowMajorOrder", "Dimensionality": values.ndim,
                  **{f"Dim{k}": n for k, n in enumerate(values.shape)}, "Encoding": encoding,
                  "Endian": "BigEndian" if big else "LittleEndian", "ExternalFileName": "", "ExternalFileOffset": 0, **changes}
    system = "" if intent != "POINTSET" else (
        "<CoordinateSystemTransformMatrix><DataSpace><![CDATA[NIFTI_XFORM_UNKNOWN]]></DataSpace><TransformedSpace>"
        f"<![CDATA[NIFTI_XFORM_TALAIRACH]]></TransformedSpace><MatrixData>{matrix}</MatrixData></CoordinateSystemTransformMatrix>")
    words = " ".join(f'{k}="{v}"' for k, v in attributes.items())
    named = name and f"<MD><Name>Geometric</Name><Value>no</Value></MD><MD><Name>Name</Name><Value><![CDATA[{name}]]></Value></MD>"
    return f"<DataArray {words}><MetaData>{named}</MetaData>{system}<Data>{text}</Data></DataArray>\n"


def write(path, *arrays, doctype='<!DOCTYPE GIFTI SYSTEM "http://www.nitrc.org/frs/download.php/115/gifti.dtd">'):
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{doctype}\n<GIFTI Version="1.0" NumberOfDataArrays="{len(arrays)}">\n'
                    + "<MetaData></MetaData><LabelTable></LabelTable>\n" + "".join(arrays) + "</GIFTI>\n")
