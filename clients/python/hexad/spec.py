# SPDX-License-Identifier: Apache-2.0
"""The members of a spec, for editors and type checkers. Written by generate.py; do not edit.

Each class is a dict. A spec may be written with them or as plain dicts and lists; a member that is left out has its
default. Ranges are of the service, which checks them.
"""
from typing import Any, Literal, Mapping, Sequence, TypedDict, Union

__all__ = [
    "AttributesItem",
    "Box",
    "Capsule",
    "Cone",
    "Cylinder",
    "Ellipsoid",
    "Gyroid",
    "Halfspace",
    "Limits",
    "Outcome",
    "OutcomeRequire",
    "Output",
    "OutputOrient",
    "OutputPly",
    "OutputPreview",
    "OutputPreviewCamera",
    "OutputUsd",
    "OutputUsdInstancer",
    "Quartic",
    "Queue",
    "QueueByFrameValue",
    "Region",
    "SampleMembers",
    "Sampling",
    "SamplingAlpha",
    "SamplingAlphaScale",
    "SamplingControl",
    "SamplingCurvature",
    "SamplingCurvatureScale",
    "SamplingFeature",
    "SamplingGrid",
    "SamplingPoints",
    "Solver",
    "SolverWitkinHeckbert",
    "Spec",
    "Sphere",
    "Surface",
    "SurfaceBspline",
    "SurfaceBsplineDomain",
    "SurfaceExr",
    "SurfaceLabels",
    "SurfaceMesh",
    "SurfaceMeshFeatures",
    "SurfaceOffset",
    "SurfaceTransform",
    "SurfaceVdb",
    "SurfaceVolume",
    "Torus",
]


class _SurfaceVdbNeeded(TypedDict):
    path: str


class _SurfaceVdbRest(TypedDict, total=False):
    grid: str
    isovalue: float
    reconstruction: Literal["interpolating", "smoothing"]


class SurfaceVdb(_SurfaceVdbNeeded, _SurfaceVdbRest):
    """A scalar grid of an OpenVDB file. The surface is where the grid has the isovalue.

    path: The file. It must lie below one of the service's input roots, or have been sent with hexadctl
        upload.
    grid: The name of the grid. If several grids have the same name, write "name[1]" for the second. Required
        if the file has several scalar grids.
    isovalue: The value on the surface. Default for a level set: 0. Required for a fog volume. (the grid's)
    reconstruction: interpolating: the spline passes through the samples. smoothing: the samples are the
        spline's coefficients; this blurs noise and moves the surface slightly. Default: 'interpolating'.
    """


class _SurfaceMeshFeaturesRest(TypedDict, total=False):
    angle: float


class SurfaceMeshFeatures(_SurfaceMeshFeaturesRest):
    """Samples along sharp edges. If omitted, feature edges are detected automatically: meshes of planes and
    arcs (CAD models) use an angle of 0.7; scanned meshes get no feature edges. If given for a scanned mesh,
    sharp edges are feature edges only in chains of at least 16 edges and 4 spacings.

    angle: Edges are sharp if the normals of their triangles differ by more than this. 0: no edge is sharp.
        (radians) Default: 0.7.
    """


class _SurfaceMeshNeeded(TypedDict):
    path: str


class _SurfaceMeshRest(TypedDict, total=False):
    voxel_size: float
    resolution: int
    max_resolution: int
    band_vox: int
    weld: float
    holes: Literal["keep", "fill"]
    interior: Literal["auto", "keep", "drop"]
    features: SurfaceMeshFeatures
    on_mesh: bool


class SurfaceMesh(_SurfaceMeshNeeded, _SurfaceMeshRest):
    """A triangle mesh. It is sampled on its triangles. A closed mesh is converted to a level set with exact
    distances if the spec has voxel_size, resolution or on_mesh false, in offsets and combinations, and if too
    much of its area is inside its solids.

    path: The file: PLY, OBJ, STL, OFF, glTF, 3MF, VTK, GIfTI, FBX or COLLADA. It must lie below one of the
        service's input roots, or have been sent with hexadctl upload. Other files that it names are read for
        the attribute base_color only (materials and images, below the input roots).
    voxel_size: A closed mesh is sampled through a level set of this voxel size, between 1/8191 and 1/8 of the
        longest side of the mesh's bounding box. Excludes resolution. (world)
    resolution: The number of voxels along the longest side of the bounding box of the mesh: a closed mesh is
        sampled through a level set. If both this and voxel_size are absent and a level set is used, hexad
        chooses 256, or more if the spacing (with resolve: min_spacing / feature.ratio) is smaller than such a
        voxel or more than 0.5 % of the area is thinner than a voxel. At 256, at least 90 % of a scanned mesh
        is within 0.05 voxels of the sampled surface; sharp edges deviate more. Twice the number requires
        three to four times the memory and time. (voxels)
    max_resolution: The maximum resolution that hexad chooses. limits.memory_mb limits it as well: the voxels
        of thin parts use at most an eighth of it. (voxels) Default: 4096.
    band_vox: The half-width of the band of distances around the mesh. Particles use four voxels on either
        side of the surface. Three give the same surface; more than four only cost time. An offset of the mesh
        makes the band as wide as it needs, up to 32. (voxels) Default: 4.
    weld: Tolerance for joining open edges, as a fraction of the longest side of the bounding box: vertices of
        open edges within this distance are welded, or snapped to another open edge, but at most within a
        tenth of the shortest edge at them. 0: only vertices with equal coordinates are welded. (longest
        sides) Default: 1e-06.
    holes: keep: an open mesh is sampled as an open surface, with points along its boundaries. fill: holes are
        filled; a mesh that then encloses no volume is refused. Default: 'keep'.
    interior: keep: all triangles are sampled, including those inside the solids of the mesh. drop: only the
        outside of the solids is sampled, by a level set; this requires a closed mesh. auto: drop if more than
        1 % of the area of a closed mesh is inside it, otherwise keep. Default: 'auto'.
    features: Samples along sharp edges. If omitted, feature edges are detected automatically: meshes of
        planes and arcs (CAD models) use an angle of 0.7; scanned meshes get no feature edges. If given for a
        scanned mesh, sharp edges are feature edges only in chains of at least 16 edges and 4 spacings.
    on_mesh: true: finally each point is projected onto the nearest triangle that faces the same way. false: a
        closed mesh is sampled through a level set without this projection. Ignored with an offset, with
        features and for open meshes. Default: True.
    """


class _SphereNeeded(TypedDict):
    shape: Literal["sphere"]
    radius: float


class _SphereRest(TypedDict, total=False):
    center: Sequence[float]


class Sphere(_SphereNeeded, _SphereRest):
    """The shape 'sphere'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    radius: sphere, cylinder, capsule: the radius. cone: the radius of the base. (world)
    """


class _TorusNeeded(TypedDict):
    shape: Literal["torus"]
    major_radius: float
    minor_radius: float


class _TorusRest(TypedDict, total=False):
    center: Sequence[float]
    axis: Sequence[float]


class Torus(_TorusNeeded, _TorusRest):
    """The shape 'torus'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    axis: torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to
        its top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its
        length does not matter. Default: [0, 0, 1].
    major_radius: torus: the distance from the centre to the middle of the tube. (world)
    minor_radius: torus: the radius of the tube. It must be less than major_radius. (world)
    """


class _BoxNeeded(TypedDict):
    shape: Literal["box"]
    half_size: Sequence[float]


class _BoxRest(TypedDict, total=False):
    center: Sequence[float]
    rounding: float


class Box(_BoxNeeded, _BoxRest):
    """The shape 'box'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    half_size: box: half of each side, including the rounding. (world)
    rounding: box, cylinder: the radius of edges and corners. It must not exceed the smallest half size, of a
        cylinder its radius and half of its height. (world) Default: 0.
    """


class _EllipsoidNeeded(TypedDict):
    shape: Literal["ellipsoid"]
    radii: Sequence[float]


class _EllipsoidRest(TypedDict, total=False):
    center: Sequence[float]


class Ellipsoid(_EllipsoidNeeded, _EllipsoidRest):
    """The shape 'ellipsoid'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    radii: ellipsoid: half of each axis. (world)
    """


class _QuarticNeeded(TypedDict):
    shape: Literal["quartic"]


class _QuarticRest(TypedDict, total=False):
    center: Sequence[float]
    r: float


class Quartic(_QuarticNeeded, _QuarticRest):
    """The shape 'quartic'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    r: quartic: r in equation (15). (world) Default: 0.13.
    """


class _GyroidNeeded(TypedDict):
    shape: Literal["gyroid"]
    period: float


class _GyroidRest(TypedDict, total=False):
    center: Sequence[float]
    size: Sequence[float]


class Gyroid(_GyroidNeeded, _GyroidRest):
    """The shape 'gyroid'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    size: gyroid: the sides of the box that cuts it. (world) Default: [1, 1, 1].
    period: gyroid: the length of one period. (world)
    """


class _CylinderNeeded(TypedDict):
    shape: Literal["cylinder"]
    radius: float
    height: float


class _CylinderRest(TypedDict, total=False):
    center: Sequence[float]
    axis: Sequence[float]
    rounding: float


class Cylinder(_CylinderNeeded, _CylinderRest):
    """The shape 'cylinder'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    radius: sphere, cylinder, capsule: the radius. cone: the radius of the base. (world)
    axis: torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to
        its top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its
        length does not matter. Default: [0, 0, 1].
    height: cylinder, cone: the length along the axis. capsule: the distance between the centres of its two
        half spheres. (world)
    rounding: box, cylinder: the radius of edges and corners. It must not exceed the smallest half size, of a
        cylinder its radius and half of its height. (world) Default: 0.
    """


class _ConeNeeded(TypedDict):
    shape: Literal["cone"]
    radius: float
    height: float


class _ConeRest(TypedDict, total=False):
    center: Sequence[float]
    axis: Sequence[float]
    top_radius: float


class Cone(_ConeNeeded, _ConeRest):
    """The shape 'cone'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    radius: sphere, cylinder, capsule: the radius. cone: the radius of the base. (world)
    axis: torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to
        its top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its
        length does not matter. Default: [0, 0, 1].
    height: cylinder, cone: the length along the axis. capsule: the distance between the centres of its two
        half spheres. (world)
    top_radius: cone: the radius of the other end; above 0 its tip is cut off. (world) Default: 0.
    """


class _CapsuleNeeded(TypedDict):
    shape: Literal["capsule"]
    radius: float
    height: float


class _CapsuleRest(TypedDict, total=False):
    center: Sequence[float]
    axis: Sequence[float]


class Capsule(_CapsuleNeeded, _CapsuleRest):
    """The shape 'capsule'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    radius: sphere, cylinder, capsule: the radius. cone: the radius of the base. (world)
    axis: torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to
        its top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its
        length does not matter. Default: [0, 0, 1].
    height: cylinder, cone: the length along the axis. capsule: the distance between the centres of its two
        half spheres. (world)
    """


class _HalfspaceNeeded(TypedDict):
    shape: Literal["halfspace"]


class _HalfspaceRest(TypedDict, total=False):
    center: Sequence[float]
    axis: Sequence[float]


class Halfspace(_HalfspaceNeeded, _HalfspaceRest):
    """The shape 'halfspace'.

    center: Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of
        its plane. (world) Default: [0.5, 0.5, 0.5].
    axis: torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to
        its top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its
        length does not matter. Default: [0, 0, 1].
    """


class _SurfaceBsplineDomainRest(TypedDict, total=False):
    min: Sequence[float]
    max: Sequence[float]


class SurfaceBsplineDomain(_SurfaceBsplineDomainRest):
    """The box in which the spline is defined.

    min: The lowest corner. (world) Default: [0, 0, 0].
    max: The highest corner. It must be above the lowest corner on every axis. (world) Default: [1, 1, 1].
    """


class _SurfaceBsplineNeeded(TypedDict):
    dims: Sequence[int]


class _SurfaceBsplineRest(TypedDict, total=False):
    domain: SurfaceBsplineDomain
    coefficients: Sequence[float]
    path: str


class SurfaceBspline(_SurfaceBsplineNeeded, _SurfaceBsplineRest):
    """The zero set of a uniform cubic B-spline, given by its coefficients. Negative values are inside. Along
    an axis with n coefficients the domain has n - 3 knot intervals of equal length w. Coefficient i, counted
    from 0, belongs to the basis function centred on min + (i - 1) w, so the first and the last coefficient
    lie one interval outside the domain.

    dims: The number of coefficients along x, y and z.
    domain: The box in which the spline is defined.
    coefficients: The coefficients; x varies fastest, then y. Their number is the product of dims.
    path: A file that contains only the coefficients, in the same order, as little-endian floats of 32 or 64
        bits. The file size determines which. It must lie below one of the service's input roots, or have been
        sent with hexadctl upload.
    """


class _SurfaceVolumeNeeded(TypedDict):
    path: str
    isovalue: float


class _SurfaceVolumeRest(TypedDict, total=False):
    index: int
    level: int
    slices: str
    voxel_size: Sequence[float]
    no_data: float
    reconstruction: Literal["interpolating", "smoothing"]


class SurfaceVolume(_SurfaceVolumeNeeded, _SurfaceVolumeRest):
    """A dense volume. The surface is where the volume has the isovalue; larger values are inside. World space
    is that of the file: for NRRD the space that the header names (left-posterior-superior is not converted),
    for NIfTI right-anterior-superior.

    path: The file: NRRD (raw, gzip or ascii data, attached or in separate files), NIfTI-1, NIfTI-2,
        MetaImage, or TIFF of several pages; with slices the images of a stack, with ####, %04d or $F4 in
        place of the slice number; or the directory of an OME-Zarr image (0.4 or 0.5). It and the files that
        it names must lie below one of the service's input roots. A file that names no other one may instead
        have been sent with hexadctl upload.
    index: Which volume of a file with more than three axes, counted from 0. Required if there are several.
        For channel c at time t of a TIFF file with C channels it is c + C t.
    level: Which resolution of an OME-Zarr directory, counted from 0, the finest. Default: 0.
    slices: The path names a stack of TIFF images or of OpenEXR images with one channel, and these are its
        slices: see /surface/exr/slices.
    voxel_size: The distance between samples along each axis of the data, in place of the one in the file. The
        directions of the axes and the position of the first sample stay. Default: that of the file; for files
        without one, 1. (world)
    isovalue: The value on the surface. The surface is open where it meets the end of the data. (the volume's)
    no_data: Samples with this value have no data, as -9999 or padding: they are outside, and are read as the
        lowest other value. Files that state such a value do not set it. (the volume's)
    reconstruction: See /surface/vdb/reconstruction. Default: 'interpolating'.
    """


class _SurfaceLabelsNeeded(TypedDict):
    path: str


class _SurfaceLabelsRest(TypedDict, total=False):
    index: int
    level: int
    slices: str
    part: str
    channel: str
    voxel_size: Sequence[float]
    origin: Sequence[float]
    grid: str
    labels: Sequence[int]
    smooth: float
    majority: float
    background: int
    closed: bool
    groups: Sequence[Sequence[int]]
    interfaces: Sequence[Sequence[int]]


class SurfaceLabels(_SurfaceLabelsNeeded, _SurfaceLabelsRest):
    """A segmentation: a volume of whole numbers, its labels. The surface is all interfaces between two of
    them, each once. Points along the lines where three meet, and along the end of the data, come first.
    Points have the properties label_a and label_b: label_a is the lower of the two labels, but a background
    is always label_b. Normals point from label_a to label_b. It must be the whole surface: it excludes
    combinations, offsets, transforms and region.

    path: The file: NRRD, NIfTI, MetaImage, TIFF of several pages, OpenVDB, or the directory of an OME-Zarr
        image; with slices the images, as in /surface/exr/path. It and the files that it names must lie below
        one of the service's input roots. A file that names no other one may instead have been sent with
        hexadctl upload.
    index: See /surface/volume/index.
    level: See /surface/volume/level.
    slices: The labels are a stack of OpenEXR or TIFF images, and these are its slices: see /surface/exr. The
        same holds for part, channel, voxel_size and origin; TIFF has no part and no channel.
    part: The name of the part. Requires slices.
    channel: The name of the channel. Requires slices.
    voxel_size: The distance between columns, rows and slices. For files with a size of their own it replaces
        that, unless it is [1, 1, 1]. (world) Default: [1, 1, 1].
    origin: The position of pixel (0, 0) of the first slice. Requires slices. (world) Default: [0, 0, 0].
    grid: The name of the grid in an OpenVDB file. Optional if there is only one of whole numbers.
    labels: The labels to sample; all others are background. Default: all.
    smooth: The cut-off wavelength of the smoothing: shorter steps are smoothed, and no vertex moves by more
        than half a voxel along an axis. 0: no smoothing. (voxels) Default: 8.
    majority: Majority filter before the surface is extracted: each voxel gets the label with the most voxels
        around it, weighted by a Gaussian with this standard deviation, in units of the smallest side of a
        voxel. It removes steps between slices that were segmented by hand, and stray voxels. 1.5 times the
        spacing of the points removes detail that they cannot resolve; wide filters take minutes. Weights
        preserve the volume of each label; parts that are thinner than the rest of their label, and specks
        with a radius below this, shrink or vanish. 0: no filter. (voxels) Default: 0.
    background: The background label. It is listed second in each interface, so normals point into it.
        Default: none; 0 is then a label like any other. `labels` and closed need a background: then the
        default is 0 if `labels` is given without 0, and otherwise one less than the lowest label, at most -1.
    closed: true: beyond the end of the data is background, and the end an interface with it. false: the
        interfaces end there. Default: False.
    groups: Labels to unite, each list under its first label: [[3, 4], [7, 8, 9]].
    interfaces: The pairs of labels whose interfaces are sampled: [[1, 2], [2, 3]]. Default: all.
    """


class _SurfaceExrNeeded(TypedDict):
    path: str
    slices: str
    isovalue: float


class _SurfaceExrRest(TypedDict, total=False):
    part: str
    channel: str
    voxel_size: Sequence[float]
    origin: Sequence[float]
    reconstruction: Literal["interpolating", "smoothing"]


class SurfaceExr(_SurfaceExrNeeded, _SurfaceExrRest):
    """A stack of OpenEXR images as a dense volume. The surface is where the volume has the isovalue; larger
    values are inside. Pixel (x, y) of slice k, counted from 0, lies at origin + voxel_size (x, y, k). Rows
    count downwards in the image. Pixels are numbered by the data window, not by the display window. The
    volume covers the data windows of all slices; a pixel outside the data window of its slice is 0. In tiled
    files with levels, the full-resolution level is read. Deep images are refused.

    path: The files, with #### (at least as many digits), %04d or $F4 in place of the slice number. They must
        lie below one of the service's input roots.
    slices: The slices: "1-93", or every second one: "1-93x2". At least 2, at most 65536.
    part: The name of the part. Optional if only one part has the channel.
    channel: The name of the channel including its layer, such as "density" or "fog.Y". Optional if there is
        only one.
    voxel_size: The distance between columns, rows and slices. (world) Default: [1, 1, 1].
    origin: The position of pixel (0, 0) of the first slice. (world) Default: [0, 0, 0].
    isovalue: The value on the surface. The surface is open where it meets the end of the data. (the
        channel's)
    reconstruction: See /surface/vdb/reconstruction. Default: 'interpolating'.
    """


class _SurfaceOffsetNeeded(TypedDict):
    surface: "Surface"
    distance: float


class SurfaceOffset(_SurfaceOffsetNeeded):
    """A surface at a constant distance from another one. The other surface must have distances: level sets,
    meshes, and formulas except ellipsoid, quartic and gyroid; also combinations of these, and transforms that
    preserve angles. Other surfaces, such as fog volumes, are refused. Edges of a combination stay sharp. The
    band of a level set must be wide enough for the offset.

    surface: The surface to offset.
    distance: The distance. Positive is outwards, negative is inwards. (world)
    """


class _SurfaceTransformNeeded(TypedDict):
    surface: "Surface"
    matrix: Sequence[float]


class SurfaceTransform(_SurfaceTransformNeeded):
    """A surface transformed by a matrix: moved, rotated, mirrored, scaled or sheared. The boundaries of an
    open surface are parallel to the world axes, so its matrix may only exchange, flip and scale axes, and
    translate. With features, and for an open mesh, any matrix is allowed.

    surface: The surface to transform.
    matrix: An invertible matrix as 16 numbers, row by row, for column vectors. The last row is 0, 0, 0, 1.
    """


class _SurfaceRest(TypedDict, total=False):
    vdb: SurfaceVdb
    mesh: SurfaceMesh
    analytic: Union[Sphere, Torus, Box, Ellipsoid, Quartic, Gyroid, Cylinder, Cone, Capsule, Halfspace]
    bspline: SurfaceBspline
    volume: SurfaceVolume
    labels: SurfaceLabels
    exr: SurfaceExr
    union: Sequence["Surface"]
    intersection: Sequence["Surface"]
    difference: Sequence["Surface"]
    offset: SurfaceOffset
    transform: SurfaceTransform


class Surface(_SurfaceRest):
    """The surface to sample. Give exactly one of its members.

    vdb: A scalar grid of an OpenVDB file. The surface is where the grid has the isovalue.
    mesh: A triangle mesh. It is sampled on its triangles. A closed mesh is converted to a level set with
        exact distances if the spec has voxel_size, resolution or on_mesh false, in offsets and combinations,
        and if too much of its area is inside its solids.
    analytic: A surface given by a formula.
    bspline: The zero set of a uniform cubic B-spline, given by its coefficients. Negative values are inside.
        Along an axis with n coefficients the domain has n - 3 knot intervals of equal length w. Coefficient
        i, counted from 0, belongs to the basis function centred on min + (i - 1) w, so the first and the last
        coefficient lie one interval outside the domain.
    volume: A dense volume. The surface is where the volume has the isovalue; larger values are inside. World
        space is that of the file: for NRRD the space that the header names (left-posterior-superior is not
        converted), for NIfTI right-anterior-superior.
    labels: A segmentation: a volume of whole numbers, its labels. The surface is all interfaces between two
        of them, each once. Points along the lines where three meet, and along the end of the data, come
        first. Points have the properties label_a and label_b: label_a is the lower of the two labels, but a
        background is always label_b. Normals point from label_a to label_b. It must be the whole surface: it
        excludes combinations, offsets, transforms and region.
    exr: A stack of OpenEXR images as a dense volume. The surface is where the volume has the isovalue; larger
        values are inside. Pixel (x, y) of slice k, counted from 0, lies at origin + voxel_size (x, y, k).
        Rows count downwards in the image. Pixels are numbered by the data window, not by the display window.
        The volume covers the data windows of all slices; a pixel outside the data window of its slice is 0.
        In tiled files with levels, the full-resolution level is read. Deep images are refused.
    union: The union of the solids. Each member is a surface and may itself be a combination. The result has a
        sharp edge where two surfaces meet. An empty member, such as the intersection of solids that do not
        overlap, is skipped with a warning.
    intersection: The intersection of the solids.
    difference: The first solid without the others. An empty solid among the others is skipped with a warning.
    offset: A surface at a constant distance from another one. The other surface must have distances: level
        sets, meshes, and formulas except ellipsoid, quartic and gyroid; also combinations of these, and
        transforms that preserve angles. Other surfaces, such as fog volumes, are refused. Edges of a
        combination stay sharp. The band of a level set must be wide enough for the offset.
    transform: A surface transformed by a matrix: moved, rotated, mirrored, scaled or sheared. The boundaries
        of an open surface are parallel to the world axes, so its matrix may only exchange, flip and scale
        axes, and translate. With features, and for an open mesh, any matrix is allowed.
    """


class _RegionRest(TypedDict, total=False):
    inside: "Surface"
    min: Sequence[float]
    max: Sequence[float]


class Region(_RegionRest):
    """Only the part of the surface inside this box, or inside another surface, is sampled. Where the box cuts
    the surface, the surface is open and points lie along the cut. The scale of curvature still comes from the
    bounding box of the whole surface.

    inside: The surface whose inside is the region. Points are placed exactly on the cut and, as with
        features, on the sharp edges of the sampled surface.
    min: The lowest corner. (world)
    max: The highest corner. It must be above the lowest corner on every axis. (world)
    """


class _SamplingControlNeeded(TypedDict):
    min_count: int
    max_sigma: float


class _SamplingControlRest(TypedDict, total=False):
    start_count: int
    selection: Literal["biased", "random"]


class SamplingControl(_SamplingControlNeeded, _SamplingControlRest):
    """For reproducing the paper; otherwise use count. Finds the smallest count that is at least min_count and
    whose support at the ideal energy is at most max_sigma (section 6.1 of the paper). Method paper starts
    with min_count points and inserts and deletes some between rounds. Method sized computes the count from
    sigma = sqrt(3) spacing. Works with the methods sized and paper.

    min_count: The least number of points. (points)
    max_sigma: The largest support of the potential. Points are inserted until the support is small enough.
        (world)
    start_count: The number of points that paper begins with, at least min_count; 0: min_count. A number near
        the result saves rounds. If it is too large, points are deleted. (points) Default: 0.
    selection: Which points are split or deleted. biased: points with little energy are more likely to be
        split, points with much energy to be deleted. random: all points are equally likely. Only the method
        paper inserts and deletes points. Default: 'biased'.
    """


class _SamplingFeatureRest(TypedDict, total=False):
    ratio: float


class SamplingFeature(_SamplingFeatureRest):
    """Finer spacing where the surface is thin or opposite walls are close: at most ratio times the feature
    size, which is half the thickness, half the gap, or the radius of a thin tube. Convex edges are not thin.
    The job fails if the count is too small, and names the count that it needs. Requires the method sized;
    excludes alpha.

    ratio: The largest spacing, over the feature size. With 0.75, opposite walls are 2.7 spacings apart; above
        1, they may remain unresolved. Default: 0.75.
    """


class _SamplingAlphaScaleRest(TypedDict, total=False):
    spacings: float
    world: float


class SamplingAlphaScale(_SamplingAlphaScaleRest):
    """The distance over which the curvature of the surface is averaged. It measures the shape instead of the
    facets of a mesh or the noise of a scan. Give one of its members. Default: two spacings.

    spacings: The distance in spacings of the even packing. 0: the curvature of the field at the point itself.
        (spacings)
    world: The distance in world units. (world)
    """


class _SamplingAlphaRest(TypedDict, total=False):
    d: float
    gamma: float
    nu: float
    kappa_max: float
    scale: SamplingAlphaScale


class SamplingAlpha(_SamplingAlphaRest):
    """Spacing by curvature with equations (13) and (14): alpha = gamma + 1 / (kappa^d + nu). kappa is
    multiplied by a length L, so that it does not depend on scale: the longest side of the box around the
    surface of a volume or mesh, of the domain of a formula or B-spline. The report states L. Excludes feature
    and curve_spacing. Requires the method paper, which is then the default, or witkin-heckbert.

    d: The exponent. A larger one follows the curvature more strongly, one below 1 more weakly. Default: 2.
    gamma: The lower bound of alpha, which alpha approaches where the curvature is strong. Default: 0.1.
    nu: Where the surface is flat, alpha is gamma + 1/nu. Default: 0.75.
    kappa_max: Larger values of the scale-free curvature are replaced by this one. Default: 20.
    scale: The distance over which the curvature of the surface is averaged. It measures the shape instead of
        the facets of a mesh or the noise of a scan. Give one of its members. Default: two spacings.
    """


class _SamplingCurvatureScaleRest(TypedDict, total=False):
    spacings: float
    world: float


class SamplingCurvatureScale(_SamplingCurvatureScaleRest):
    """The distance over which the curvature of the surface is averaged. It measures the shape instead of the
    facets of a mesh or the noise of a scan. Give one of its members. Default: 4 local spacings.

    spacings: The distance in local spacings. 0: the curvature at the point itself. (spacings)
    world: The distance in world units. (world)
    """


class _SamplingCurvatureRest(TypedDict, total=False):
    chord_error: float
    ratio: float
    exponent: float
    scale: SamplingCurvatureScale


class SamplingCurvature(_SamplingCurvatureRest):
    """Spacing by curvature: finer where the surface bends. The requested spacing is scaled so that it needs
    as many points as the target. Requires the method sized.

    chord_error: Spacing sqrt(8 chord_error / max(|kappa1|, |kappa2|)): the chord between two neighbours
        deviates from the surface by chord_error. The report states the nominal error of the count, and with
        output.mesh the largest one of the mesh. (world)
    ratio: The maximum ratio of the largest to the smallest spacing. The spacing is proportional to
        kappa^-exponent. A surface with almost uniform curvature reaches a smaller ratio. The smallest spacing
        is used on the most curved 1 % of the area, or on as little as 1/8 % if gradation would otherwise
        reduce the ratio below 0.8 of this value.
    exponent: How strongly the spacing follows the curvature. Belongs to ratio. Default: 1.
    scale: The distance over which the curvature of the surface is averaged. It measures the shape instead of
        the facets of a mesh or the noise of a scan. Give one of its members. Default: 4 local spacings.
    """


class _SamplingGridNeeded(TypedDict):
    name: str


class _SamplingGridRest(TypedDict, total=False):
    path: str
    component: int
    kind: Literal["spacing", "density"]


class SamplingGrid(_SamplingGridNeeded, _SamplingGridRest):
    """Spacing from a painted map: a scalar grid of an OpenVDB file, or a value of the vertices of a mesh
    file. The requested spacing is scaled so that it needs as many points as the target. Requires the method
    sized.

    path: The file: OpenVDB, or a mesh. Default: that of the surface, which then must be a grid of an OpenVDB
        file or a mesh. Any surface may have a map in a file of its own, in world space; a mesh gives each
        place the value of the nearest point of its triangles.
    name: The name of the grid. If several grids have the same name, write "name[1]" for the second. Of a
        mesh: the name of a value of its vertices, as in attributes: a property of a PLY file such as quality,
        an array of the points of a VTK or GIfTI file, or color.
    component: The component of the value of the vertices. Of a color, 0 to 3 are red, green, blue and
        opacity, from 0 to 1. Required if the value has several components; only for meshes.
    kind: spacing: values are distances between neighbours, above 0. density: values are points per unit of
        area; where the density is 0, only max_spacing and gradation determine the points. Default: 'spacing'.
    """


class _SamplingPointsNeeded(TypedDict):
    path: str
    mode: Literal["keep", "refine", "avoid"]


class _SamplingPointsRest(TypedDict, total=False):
    distance: float


class SamplingPoints(_SamplingPointsNeeded, _SamplingPointsRest):
    """Points that are given, from a file. Each must be within 0.1 spacings of the surface. The target is the
    number of all points of the result: with mode keep it includes the given ones. Requires the method sized;
    excludes control, resolve, queue.coherent and any solver.init but surface.

    path: The file: PLY, or NPZ of NumPy with an array position or points of shape (N, 3). It must lie below
        one of the service's input roots, or have been sent with hexadctl upload. Only the positions are read,
        in world space.
    mode: keep: the points are in the result, at the same positions and first; the other points arrange
        themselves around them, and the attribute kept is 1 for them and 0 for the others. refine: the solve
        starts with the points, and inserts others between them. avoid: the points are not in the result,
        whose points keep the distance from them.
    distance: The least distance of the result's points from the given points. Required by mode avoid. (world)
    """


class _SamplingRest(TypedDict, total=False):
    count: int
    spacing: float
    density: float
    pattern: Literal["hexagonal", "blue_noise"]
    control: SamplingControl
    resolve: bool
    attach: str
    feature: SamplingFeature
    alpha: SamplingAlpha
    curvature: SamplingCurvature
    grid: SamplingGrid
    points: SamplingPoints
    curve_spacing: float
    min_spacing: float
    max_spacing: float
    gradation: float


class Sampling(_SamplingRest):
    """The number of points. Give exactly one target (count, spacing, density, control, resolve or attach) and
    at most one rule for the spacing (alpha, curvature or grid). feature refines thin parts, and curve_spacing
    the surface near curves; both may be combined with curvature or grid.

    count: The exact number of points. (points)
    spacing: The mean distance between neighbours. The count is 2 A / (sqrt(3) spacing^2), where A is the
        area. (world)
    density: The number of points per unit of area. (1/world^2)
    pattern: hexagonal: the points are as regular as the surface permits. blue_noise: the points have no
        regular order, for scattering, stippling and ray-traced sets. Their least distance is at least 0.74
        spacings, and no place of the surface is farther from its nearest point than 1.05 times that distance.
        The least distance does not apply to points on opposite walls, whose normals differ by more than 113
        degrees. Curves have no points of their own. blue_noise requires a surface without labels and the
        defaults of solver.method, init, energy, minimiser and sigma; excludes control, resolve, attach,
        alpha, points, curve_spacing, features and queue.coherent. Default: 'hexagonal'.
    control: For reproducing the paper; otherwise use count. Finds the smallest count that is at least
        min_count and whose support at the ideal energy is at most max_sigma (section 6.1 of the paper).
        Method paper starts with min_count points and inserts and deletes some between rounds. Method sized
        computes the count from sigma = sqrt(3) spacing. Works with the methods sized and paper.
    resolve: true, the only permitted value: hexad chooses the count that resolves the surface, from the
        spacing that feature and grid require, at most max_spacing. The report and the estimate state the
        count. Requires feature ("feature": {} is enough); excludes curvature. A closed mesh is then sampled
        on its triangles, including those inside its solids, as with sharp edges (/surface/mesh/features), and
        mesh.ply has the topology of the mesh.
    attach: The path of the points.ply of an earlier result, whose points have places on meshes (attributes:
        from geometry, name source). The surface is then not sampled: these points are placed on its meshes,
        which must have the same vertices and faces in the same order, such as another frame of an animation.
        Requires a surface that is a mesh, or has one as a part; excludes all other members of sampling,
        output.mesh, output.convergence, output.order, queue.coherent and outcome.require.
    feature: Finer spacing where the surface is thin or opposite walls are close: at most ratio times the
        feature size, which is half the thickness, half the gap, or the radius of a thin tube. Convex edges
        are not thin. The job fails if the count is too small, and names the count that it needs. Requires the
        method sized; excludes alpha.
    alpha: Spacing by curvature with equations (13) and (14): alpha = gamma + 1 / (kappa^d + nu). kappa is
        multiplied by a length L, so that it does not depend on scale: the longest side of the box around the
        surface of a volume or mesh, of the domain of a formula or B-spline. The report states L. Excludes
        feature and curve_spacing. Requires the method paper, which is then the default, or witkin-heckbert.
    curvature: Spacing by curvature: finer where the surface bends. The requested spacing is scaled so that it
        needs as many points as the target. Requires the method sized.
    grid: Spacing from a painted map: a scalar grid of an OpenVDB file, or a value of the vertices of a mesh
        file. The requested spacing is scaled so that it needs as many points as the target. Requires the
        method sized.
    points: Points that are given, from a file. Each must be within 0.1 spacings of the surface. The target is
        the number of all points of the result: with mode keep it includes the given ones. Requires the method
        sized; excludes control, resolve, queue.coherent and any solver.init but surface.
    curve_spacing: The spacing of points on curves (sharp edges, boundaries of meshes, curves of features), as
        a fraction of the spacing around them. Away from the curves it grows by gradation; the count does not
        change. It may be combined with curvature, grid or feature. It has no effect on a surface without
        curves. Requires the method sized; excludes alpha.
    min_spacing: The smallest spacing. Requires curvature, grid, feature or curve_spacing, and is refused
        without them. feature uses no spacing below it. Default for feature: a quarter of a voxel; of a cell
        for a formula; for a mesh with resolve, 1/256 of its longest side or a quarter of the side of its
        triangles, more if its area is large. (world)
    max_spacing: The largest spacing. Requires curvature, grid, feature or curve_spacing, and is refused
        without them. At least min_spacing. (world)
    gradation: The largest increase of the spacing per unit of distance along the surface. Requires curvature,
        grid, feature or curve_spacing, and is refused without them. Default: 0.2.
    """


class _SolverWitkinHeckbertRest(TypedDict, total=False):
    alpha: float
    e_hat: float
    rho: float
    phi: float
    beta: float
    dt: float
    gamma: float
    nu: float
    delta: float
    sigma_max: float


class SolverWitkinHeckbert(_SolverWitkinHeckbertRest):
    """Parameters of the method "witkin-heckbert", with the symbols and defaults of its paper (1994). The
    target radius, sigma_hat, follows from the sampling target.

    alpha: alpha: the amplitude of the repulsion, E_ij = alpha exp(-r^2 / (2 sigma_i^2)). It scales the speed.
        Default: 6.
    e_hat: E_hat divided by alpha: the energy that each particle aims at. A larger one gives a denser
        sampling. At 0.8 neighbours are two sigma apart. Default: 0.8.
    rho: rho: how fast the radius of a particle follows its energy, dD/dt = -rho (D - E_hat). Default: 15.
    phi: phi: how fast a particle returns to the surface, dF/dt = -phi F: the feedback term of (2). Default:
        15.
    beta: beta: keeps the rate of a radius finite where a particle has no neighbours. In units of 1 / sigma_i;
        the paper of 1994 uses 1 / length. Default: 10.
    dt: Delta t: the time step of Euler's method. With the other defaults it is unstable above about 0.07.
        (time) Default: 0.03.
    gamma: gamma: a particle slower than gamma sigma_i is near its equilibrium and may be split or deleted.
        Default: 4.
    nu: nu: a particle whose radius exceeds its target is split when its energy exceeds nu E_hat. Default:
        0.2.
    delta: delta: a particle may be deleted when its radius is below delta times its target radius. The
        smaller the radius, the more likely. Default: 0.7.
    sigma_max: sigma_max: a particle with a larger radius is always split. 0: the larger of half the longest
        side of the surface and 1.5 target radii. (world) Default: 0.
    """


class _SolverRest(TypedDict, total=False):
    method: Literal["sized", "paper", "witkin-heckbert"]
    energy: Literal["cotangent", "gaussian", "electrostatic"]
    minimiser: Literal["lm", "gradient"]
    step: float
    sigma: float
    witkin_heckbert: SolverWitkinHeckbert
    init: Literal["surface", "random", "sized"]
    seed: int
    threads: int
    isa: Literal["auto", "portable", "avx2", "avx512"]
    max_sweeps: int
    step_tolerance: float
    energy_tolerance: float


class Solver(_SolverRest):
    """How the points are computed.

    method: paper: the particle system of Meyer, Georgel and Whitaker (2005). sized: the same system, solved
        from coarse to fine; it leaves fewer defects in less time. witkin-heckbert: the method that the paper
        compares itself with. It has its own Gaussian energy, splits and deletes points at any time and does
        not reach the requested count exactly. sampling.alpha requires paper (then the default) or witkin-
        heckbert; curvature, grid, feature and curve_spacing require sized; control requires sized or paper.
        Default: 'sized'.
    energy: cotangent: equations (6) and (7). gaussian and electrostatic are for comparison, see section 4.
        The standard deviation of the Gaussian is a third of the support; the electrostatic energy is cut off
        at the support. Default: 'cotangent'.
    minimiser: lm: Levenberg-Marquardt with one lambda per particle, section 5. gradient: steepest descent (5)
        with a fixed step, as in Table 1. Default: 'lm'.
    step: The step of the gradient minimiser: a factor of the force, in units of sigma^2. The cotangent energy
        overshoots above about 0.2. Belongs to gradient. (sigma^2) Default: 0.05.
    sigma: The initial support of the potential. It adapts to the count. 0: computed from count and area.
        (world) Default: 0.
    witkin_heckbert: Parameters of the method "witkin-heckbert", with the symbols and defaults of its paper
        (1994). The target radius, sigma_hat, follows from the sampling target.
    init: surface: the first points are distributed over the surface by area. random: they are uniform in the
        domain or, for volumes, in the voxels that the surface crosses. sized: a packing computed from coarse
        to fine as by the method sized, then refined by the chosen method. Its sweeps are part of the start
        and are not in the report. With sampling.alpha and the method paper the packing has the amplitudes;
        with the energy cotangent, the minimiser lm and no sampling.control it is the result, and its sweeps
        are in the report. Default: sized if sampling.alpha is given, otherwise surface. sampling.points
        excludes random and sized. Default: 'surface'.
    seed: The seed of the random numbers. The same spec, seed and build give the same bytes. Default: 0.
    threads: The number of threads; 0: those that the service gives to each worker. The result does not depend
        on it. Default: 0.
    isa: The instruction set of the numerical kernels; auto: the best one that the machine supports. The
        result does not depend on it. Default: 'auto'.
    max_sweeps: The maximum number of sweeps; the solver stops then, converged or not. (sweeps) Default: 5000.
    step_tolerance: Convergence requires an rms step below this. For witkin-heckbert it is the rms
        displacement per unit of time. Below 0.003 only a few defects still move: 0.001 doubles the sweeps and
        changes the quality less than another seed. (spacings) Default: 0.003.
    energy_tolerance: The maximum relative difference between the mean energy of the points and the ideal one,
        for the methods that choose the support of the energy (every method except sized). A larger difference
        is the criterion target_energy of the outcome not_converged. Default: 0.05.
    """


class _OutcomeRequireRest(TypedDict, total=False):
    hex_fraction: float
    edge_cv: float
    area_cv: float
    energy_excess: float
    disorder: float
    defect_share: float
    min_spacing_ratio: float
    close_share: float
    coverage: float
    missing_share: float
    unmeasured_share: float
    max_residual: float
    rms_residual: float


class OutcomeRequire(_OutcomeRequireRest):
    """Bounds on measures of the report. A result that violates one has the outcome unresolved, with that
    measure as the criterion.

    hex_fraction: The smallest value of quality.hex_fraction that is accepted.
    edge_cv: The largest value of quality.edge_cv that is accepted.
    area_cv: The largest value of quality.area_cv that is accepted.
    energy_excess: The largest value of quality.energy_excess that is accepted.
    disorder: The largest value of quality.disorder that is accepted.
    defect_share: The largest value of quality.defect_share that is accepted.
    min_spacing_ratio: The smallest value of quality.min_spacing_ratio that is accepted.
    close_share: The largest value of quality.close_share that is accepted.
    coverage: The largest value of quality.coverage that is accepted.
    missing_share: The largest value of quality.missing_share that is accepted.
    unmeasured_share: The largest value of quality.unmeasured_share that is accepted.
    max_residual: The largest value of quality.max_residual that is accepted.
    rms_residual: The largest value of quality.rms_residual that is accepted.
    """


class _OutcomeRest(TypedDict, total=False):
    require: OutcomeRequire


class Outcome(_OutcomeRest):
    """Requirements on the result in addition to the criteria of every job (doc/report.md).

    require: Bounds on measures of the report. A result that violates one has the outcome unresolved, with
        that measure as the criterion.
    """


_AttributesItemRest = TypedDict("_AttributesItemRest", {
    "from": str,
    "name": str,
    "as": str,
    "type": Literal["auto", "float", "int", "vector", "normal", "color", "uv"],
    "interpolation": Literal["linear", "cubic", "nearest"],
}, total=False)


class AttributesItem(_AttributesItemRest):
    """Members of a spec.

    from: Where the values are. surface: in the file of the surface, of a combined surface in the first of its
        files. geometry: in the surface itself. Anything else is the path of an OpenVDB, NRRD, NIfTI or mesh
        file in the same space; it moves with the transforms of the surface. Default: 'surface'.
    name: The grid of an OpenVDB file (any of numbers or vectors), the channel of a stack of images, the
        component of an NRRD file with several values at a place (0, 1, ...; all of them if this is absent),
        or the name of a value of the vertices of a mesh, or base_color: the colour of its materials and
        images. Geometric quantities: part (the number of the part of a combined surface, from 0), direction1
        or direction2 (of the principal curvatures), source (the place on the mesh: source_mesh, source_face,
        source_corner and source_bary; doc/formats.md), weight (the quadrature weight: the sum of weight times
        f approximates the integral of f; excludes sampling.attach and given points with mode avoid).
    as: The name in the outputs: letters, digits and _. Default: the name, with _ for other characters.
    type: The type of the values. Transforms of the surface rotate and scale vectors, rotate normals, and
        leave other types unchanged. A color is also written as the colour of the points in each format, a uv
        as texture coordinates. auto: int for whole numbers, vector for three components, float for others;
        for a mesh, the type of its value. Default: 'auto'.
    interpolation: Between the samples of a grid. cubic: Catmull and Rom's splines, which go through the
        samples. Whole numbers are always those of the nearest sample. Default: 'linear'.
    """


class _OutputOrientRest(TypedDict, total=False):
    twist: str
    seed: int
    up: Sequence[float]


class OutputOrient(_OutputOrientRest):
    """Members of a spec.

    twist: The attribute, by its name in the outputs, that gives the twist: a number is an angle in radians; a
        vector is the direction to which +x turns, as far as it is tangential.
    seed: The twist is a random angle, computed from this seed and the id of the point (its row, unless it is
        a point of a coherent sequence).
    up: The direction to which +z turns at every point, in place of the normal: [0, 0, 1] or [0, 1, 0] for
        trees that grow straight up on a slope. Normals, if they are written, stay those of the surface.
    """


class _OutputPlyRest(TypedDict, total=False):
    format: Literal["binary_little_endian", "ascii"]
    precision: Literal["float", "double"]
    properties: Union[str, Sequence[str]]


class OutputPly(_OutputPlyRest):
    """Options of points.ply.

    format: The encoding of points.ply. Default: 'binary_little_endian'.
    precision: The type of all properties of points.ply except id. Default: 'float'.
    properties: Which properties points.ply has, in this order; x, y and z come first. default: the normals,
        spacing_local, spacing if the spacing is graded, the attributes, and id and velocity of coherent
        sequences. all: all that doc/report.md lists. The name of an application: the properties that it
        reads: blender, houdini, meshlab, or minimal (positions and normals). doc/formats.md has further
        names. red, green and blue are those of an attribute of colours, else the colours of alpha or the
        curvature, with the map of the preview. Without the list: default, with attach all that the points of
        the result have.
    """


class _OutputPreviewCameraNeeded(TypedDict):
    position: Sequence[float]
    target: Sequence[float]


class _OutputPreviewCameraRest(TypedDict, total=False):
    up: Sequence[float]
    fov: float
    orthographic: float


class OutputPreviewCamera(_OutputPreviewCameraNeeded, _OutputPreviewCameraRest):
    """The camera. Without it, the surface is seen from the right, the front and above, and fills the image.

    position: The position of the eye. Points behind it are not visible, also in orthographic images. (world)
    target: The point in the middle of the image. (world)
    up: The direction that points up in the image; default: the axis of up. It must not be parallel to the
        line of sight. A turntable rotates about it.
    fov: The angle of view along the longer side of the image. 0.452 if neither fov nor orthographic is given.
        (radians)
    orthographic: Selects parallel projection: the length that the longer side of the image shows. (world)
    """


class _OutputPreviewRest(TypedDict, total=False):
    size: Union[int, Sequence[int]]
    color: Literal["alpha", "curvature", "energy", "spacing", "degree", "shading"]
    attribute: str
    range: Sequence[float]
    map: Literal["viridis", "gray", "diverging"]
    channels: Literal["basic", "all"]
    compression: Literal["none", "rle", "zips", "zip"]
    up: Literal["auto", "y", "z"]
    camera: OutputPreviewCamera
    turntable: int


class OutputPreview(_OutputPreviewRest):
    """Members of a spec.

    size: The side of a square image, or [width, height]. (pixels) Default: [512, 512].
    color: The quantity that the colours show: the amplitude alpha, the curvature kappa, the energy of a
        particle, the achieved spacing, or the number of neighbours (degree). shading: one colour, shaded by
        the normals; it excludes range, and map has no effect. Default: alpha if sampling.alpha is given;
        spacing if the spacing is graded, in a sequence only with min_spacing and max_spacing, which are then
        the range; otherwise shading.
    attribute: The attribute that the colours show instead of color, by its name in the outputs; for a vector,
        its length. An attribute of type color is shown unchanged. Surfaces with patches also have patch and
        feature, labels have label_a and label_b.
    range: The values at both ends of the colours, the lower one first. Requires attribute, or a color other
        than shading. Default: the 2nd and the 98th percentile.
    map: The colours. diverging: from blue through nearly white, the middle of the range, to red. Default:
        'viridis'.
    channels: The channels of preview.exr. basic: R, G, B, A, Z and id, by which points.ply has the rest of a
        point. all: also the place and the normal (P, N), kappa and spacing, in three times as many bytes.
        Default: 'basic'.
    compression: The compression of preview.exr, always without loss. At 512 x 512 pixels zip, 16 lines at
        once, gives 0.4 to 1 MB; zips, line by line, a ninth more; rle 2 MB; none 4.2 MB (12.6 with all
        channels). Default: 'zip'.
    up: The axis that points up unless a camera says so. auto: y for OpenVDB files and most meshes; z for STL,
        3MF, VTK (.vtk, .vtp) and GIfTI (.gii) meshes and all other surfaces. For an OBJ, OFF, PLY or STL
        file, the other axis if the mesh has a flat base along that axis only. The first part of a combination
        decides. Default: 'auto'.
    camera: The camera. Without it, the surface is seen from the right, the front and above, and fills the
        image.
    turntable: The number of images of one full rotation around the surface: preview.0001.png and so on; 0:
        none. The axis is the camera's up direction through its target. Without a camera it is the axis that
        is up, through the centre of the points. (frames) Default: 0.
    """


class _OutputUsdInstancerNeeded(TypedDict):
    prototype: str


class _OutputUsdInstancerRest(TypedDict, total=False):
    scale: str
    size: float


class OutputUsdInstancer(_OutputUsdInstancerNeeded, _OutputUsdInstancerRest):
    """points.usda has a UsdGeomPointInstancer instead of UsdGeomPoints: each point is an instance of a
    prototype, with the orientation of output.orient (without it, the shortest turn of +z to the normal).
    Requires points_usda.

    prototype: The path of the USD file whose default prim is the prototype, such as ./rock.usda. It is
        written as given; programs that open points.usda resolve a relative path from its directory. hexad
        does not open the file.
    scale: The attribute, by its name in the outputs, that scales the prototype: a number, or a vector of
        three components for its axes. Default: the achieved spacing at the point, so a prototype of size 1 is
        as large as the spacing.
    size: A factor of all scales. Default: 1.
    """


class _OutputUsdRest(TypedDict, total=False):
    instancer: OutputUsdInstancer


class OutputUsd(_OutputUsdRest):
    """Options of points.usda.

    instancer: points.usda has a UsdGeomPointInstancer instead of UsdGeomPoints: each point is an instance of
        a prototype, with the orientation of output.orient (without it, the shortest turn of +z to the
        normal). Requires points_usda.
    """


class _OutputRest(TypedDict, total=False):
    order: Literal["progressive", "spatial", "id"]
    orient: Union[bool, OutputOrient]
    ply: OutputPly
    preview: Union[bool, OutputPreview]
    preview_exr: bool
    convergence: bool
    points_vdb: bool
    points_npz: bool
    points_vtp: bool
    points_glb: bool
    points_usda: bool
    usd: OutputUsd
    mesh: bool
    mesh_usda: bool
    label_meshes: bool
    directory: str


class Output(_OutputRest):
    """The files to write.

    order: The order of the points in all outputs. progressive: the first n points are spread evenly over the
        surface, for any n, so a program that reads the beginning of a file has a coarser sampling. spatial:
        along Morton's curve, so points that are close in the file are close in space. id: ascending ids;
        requires queue.coherent. Default: the order of the solver, which may differ from version to version.
    orient: Whether the points have orient, a unit quaternion x y z w that turns +z to the normal: orient_x,
        orient_y, orient_z and orient_w in PLY files, orient in all others. true: by the shortest turn. An
        object can add a turn about +z before it, the twist, and replace the normal by the direction up.
    ply: Options of points.ply.
    preview: The picture preview.png. false: it is not written. true or an object: it is, and preview.exr if
        preview_exr is true; the object has the members below.
    preview_exr: Whether to write preview.exr, beside preview.png: the picture with data in each pixel.
        Default: False.
    convergence: Whether to write convergence.csv: energy, lambda, step and count of each sweep. Default:
        False.
    points_vdb: Whether to write points.vdb: an OpenVDB points grid with N, pscale (half the achieved spacing)
        and id (the index of the point in points.ply, from 0). Default: False.
    points_npz: Whether to write points.npz: an array of NumPy for each property and attribute, in double
        precision. Default: False.
    points_vtp: Whether to write points.vtp: VTK PolyData with each point as a vertex and an array for each
        property and attribute, in double precision. Default: False.
    points_glb: Whether to write points.glb: the points as glTF, with normals, colours and all attributes.
        Default: False.
    points_usda: Whether to write points.usda: UsdGeomPoints as text, with widths, normals, colours and all
        attributes. Default: False.
    usd: Options of points.usda.
    mesh: Whether to write mesh.ply: triangles whose vertices are the points, with the order and properties of
        points.ply. The member mesh of the report states whether the triangles close the surface. Excludes
        sampling.points with mode avoid. Default: False.
    mesh_usda: Whether to write the mesh as mesh.usda, too: a UsdGeomMesh as text. Requires mesh. Default:
        False.
    label_meshes: Whether to write mesh_label_N.ply for each label N except the background: the part of the
        mesh that bounds the label, with outward normals. Such a mesh is closed unless its label reaches the
        end of the data, which is an interface with surface.labels.closed. Requires mesh and surface.labels.
        Default: False.
    directory: The service copies the results into this directory: an absolute path below one of its output
        roots. It is created if missing. Files of the same name are replaced. In a sequence, ####, %04d or $F4
        stands for the frame number.
    """


class _LimitsRest(TypedDict, total=False):
    memory_mb: int
    timeout_s: float
    stall_s: float
    max_chunks: int
    image_pixels: int
    image_scans: int
    max_attempts: int


class Limits(_LimitsRest):
    """The resources that the job may use. 0: the default of the service or of the worker.

    memory_mb: The memory of the worker; 0: the service's setting. A job that requires more for its points,
        grids or pictures ends with limit_memory before it allocates it. If systemd has delegated a control
        group to the service, the kernel kills a worker that uses more, also with limit_memory. Without a
        control group, use can briefly exceed the limit: the address space is limited to this value plus 512
        MiB plus 80 MiB for each processor. (MiB) Default: 0.
    timeout_s: The time that the job, or each frame of it, may run, summed over all attempts. Attempts that
        the service itself stopped, as for a restart, do not count. (s) Default: 0.
    stall_s: An attempt without progress for this long is stopped, and tried again up to max_attempts. (s)
        Default: 0.
    max_chunks: The maximum number of chunks of an OME-Zarr directory that are read. A region, or a coarser
        level, needs fewer. (chunks) Default: 100000.
    image_pixels: The maximum width times height of an image of a mesh (attributes: base_color). A larger one
        is refused before it is decoded. (pixels) Default: 268435456.
    image_scans: The maximum number of scans of a progressive JPEG image of a mesh. Usual images have about
        ten; each takes the time of a decoding. (scans) Default: 500.
    max_attempts: The maximum number of attempts if the worker crashes. (attempts) Default: 0.
    """


_QueueByFrameValueNeeded = TypedDict("_QueueByFrameValueNeeded", {
    "from": float,
    "to": float,
})


class QueueByFrameValue(_QueueByFrameValueNeeded):
    """Members of a spec.

    """


class _QueueRest(TypedDict, total=False):
    priority: int
    labels: Sequence[str]
    depends_on: Sequence[str]
    after: Sequence[str]
    after_frames: Sequence[str]
    accept: Sequence[Literal["converged", "unresolved", "not_converged"]]
    frames: str
    by_frame: Mapping[str, Union[Sequence[Any], QueueByFrameValue]]
    files: Union[str, Sequence[str]]
    max_running: int
    chunk: int
    coherent: bool
    retention_s: int
    webhook: str
    slurm: Sequence[str]


class Queue(_QueueRest):
    """The job's place in the queue.

    priority: Jobs of higher priority run first. Default: 0.
    labels: Words to search for the job by, each 1 to 100 characters long. Default: [].
    depends_on: Identifiers of jobs that must succeed before this one starts. If one of them does not succeed,
        this job fails. Default: [].
    after: Identifiers of jobs that must end before this one starts, successful or not. Default: [].
    after_frames: Identifiers of arrays of the same user with all frames of this job. Each frame of this job
        starts when the same frame of these jobs has succeeded with an accepted outcome. If it ends otherwise,
        the frame of this job fails. Requires frames. Default: [].
    accept: The outcomes of this job that its users accept; for an array, of each of its frames. A job that
        names this one in depends_on or after_frames starts only if this job has such an outcome, and fails
        otherwise. hexadctl wait --accept exits with 0 if the outcome is in the list. The state and the
        outcome of the job do not change. Default: ['converged', 'unresolved', 'not_converged'].
    frames: The frame numbers; the job has one task per frame: "1-100", "1-100x2", "1-10,20". The first ####,
        %04d or $F4 in each input path stands for the frame number. At least one input path must contain one,
        unless by_frame is given; output.directory must contain one in any case. At most 100000 frames. "all":
        the frames of all files of the first such path at the submission.
    by_frame: Members of the spec that change from frame to frame, by JSON Pointer. Each has a list of exactly
        one value for each frame, {"/solver/seed": [1, 2, 3]}, or a ramp, {"/surface/analytic/radius":
        {"from": 1, "to": 2}}: linear in the frame number, from the lowest to the highest frame. Only members
        of surface, region, sampling, solver and output may change; paths, slices, solver.threads and
        output.directory may not. At most 10000 frames.
    files: The files of a data set; the job has one frame for each. A list of names, or a pattern such as
        "meshes/*.ply", with * in its last part. At the submission, the service replaces a pattern by the
        names of the files that exist below the input roots, in the order of their bytes. {file} in one input
        path stands for the name: {"mesh": {"path": "{file}"}}. Frame k has file k, from 0. Names of uploads
        may be listed if the path is {file}. Excludes frames, by_frame, coherent and after_frames. At most
        100000 files; the setting max_files of the service may be lower.
    max_running: The maximum number of frames that run at the same time; 0: as many as the service has room
        for. (frames) Default: 0.
    chunk: The number of consecutive frames that run one after another, as the chunk size of render managers.
        Each frame has limits, attempts and a result of its own. Above 1 it requires frames and excludes
        coherent. (frames) Default: 1.
    coherent: Whether each frame starts with the points of the frame before. The points follow the motion of
        the surface and keep their ids. Requires frames and the method sized; excludes features,
        sampling.points and sampling.alpha. Default: False.
    retention_s: How long the job and its results are kept after its end; 0: the service's setting. (s)
        Default: 0.
    webhook: An http or https address that the service calls when the job has ended. The service must allow
        its host. The service repeats the call until the answer is 2xx or the number of retries is reached. A
        receiver may be called more than once for the same end, with the same webhook-id, and is called again
        when a retried job ends.
    slurm: Options of sbatch for the job's attempts, as "--partition=gpu", where the service runs them in
        Slurm. The service must allow each (its setting slurm_allow). Default: [].
    """


class _SpecNeeded(TypedDict):
    surface: Surface
    sampling: Sampling


class _SpecRest(TypedDict, total=False):
    version: int
    name: str
    region: Region
    features: bool
    solver: Solver
    outcome: Outcome
    attributes: Sequence[AttributesItem]
    output: Output
    limits: Limits
    queue: Queue


class Spec(_SpecNeeded, _SpecRest):
    """The spec of a job. hexad-worker spec-help describes each member.

    version: The version of the spec's format.
    name: A descriptive name. hexad does not interpret it.
    surface: The surface to sample. Give exactly one of its members.
    region: Only the part of the surface inside this box, or inside another surface, is sampled. Where the box
        cuts the surface, the surface is open and points lie along the cut. The scale of curvature still comes
        from the bounding box of the whole surface.
    features: Whether points are placed exactly on the sharp edges of formulas, on the curves where parts of a
        combination meet, and on the cuts of a region, at the requested spacing. The surface is then divided
        into smooth patches, and mesh.ply has edges along their boundaries. For meshes, use
        /surface/mesh/features. Default: False.
    sampling: The number of points. Give exactly one target (count, spacing, density, control, resolve or
        attach) and at most one rule for the spacing (alpha, curvature or grid). feature refines thin parts,
        and curve_spacing the surface near curves; both may be combined with curvature or grid.
    solver: How the points are computed.
    outcome: Requirements on the result in addition to the criteria of every job (doc/report.md).
    attributes: Values from files that are interpolated at the points and written to every output, such as
        temperature, velocity or colours. doc/formats.md lists their names in each format.
    output: The files to write.
    limits: The resources that the job may use. 0: the default of the service or of the worker.
    queue: The job's place in the queue.
    """


class SampleMembers(TypedDict, total=False):
    """Keywords of hexad.sample: members of sampling and of the surface. An array may be in place of a path."""

    spacing: float
    density: float
    pattern: Literal["hexagonal", "blue_noise"]
    control: SamplingControl
    resolve: bool
    attach: str
    feature: SamplingFeature
    alpha: SamplingAlpha
    curvature: SamplingCurvature
    grid: Union[str, Mapping[str, Any]]
    points: Any
    curve_spacing: float
    min_spacing: float
    max_spacing: float
    gradation: float
    voxel_size: Union[float, Sequence[float]]
    resolution: int
    max_resolution: int
    band_vox: int
    weld: float
    holes: Literal["keep", "fill"]
    interior: Literal["auto", "keep", "drop"]
    features: SurfaceMeshFeatures
    on_mesh: bool
    index: int
    level: int
    slices: str
    isovalue: float
    no_data: float
    reconstruction: Literal["interpolating", "smoothing"]
