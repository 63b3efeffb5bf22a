"""Tables of a recipe that come in kinds: each kind is one class, in one file, and one line here.

The class is a model of the table and says what becomes of it. It is imported when a recipe first names its
kind, from a room of this package or from another package, which adds kinds by entry points.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticKnownError, core_schema

from ..core.registry import Registry
from .base import RecipeModel


class KindModel(RecipeModel):
    """A table that comes in kinds. Each kind narrows `kind` to its own name."""

    kind: str


MASKS: Registry[type[KindModel]] = Registry(
    "edofsim.masks",
    "mask",
    {
        "clear": "edofsim.optics.masks.clear:ClearMask",
        "annular": "edofsim.optics.masks.annular:AnnularMask",
        "gaussian": "edofsim.optics.masks.gaussian:GaussianMask",
        "coded": "edofsim.optics.masks.coded:CodedMask",
        "cubic": "edofsim.optics.masks.cubic:CubicMask",
        "logarithmic": "edofsim.optics.masks.logarithmic:LogarithmicMask",
        "sinusoidal": "edofsim.optics.masks.sinusoidal:SinusoidalMask",
        "tangent": "edofsim.optics.masks.tangent:TangentMask",
        "rings": "edofsim.optics.masks.rings:RingsMask",
        "zernike": "edofsim.optics.masks.zernike:ZernikeMask",
        "fourier": "edofsim.optics.masks.fourier:FourierMask",
        "height-map": "edofsim.optics.masks.height_map:HeightMapMask",
    },
    "edofsim.optics.masks.base:Mask",
)
LENSES: Registry[type[KindModel]] = Registry(
    "edofsim.lenses",
    "lens",
    {
        "plano-convex": "edofsim.optics.lenses.plano_convex:PlanoConvexLens",
        "ideal": "edofsim.optics.lenses.ideal:IdealLens",
        "achromat": "edofsim.optics.lenses.achromat:AchromatLens",
        "prescription": "edofsim.optics.lenses.prescription:PrescriptionLens",
        "measured": "edofsim.optics.lenses.measured:MeasuredLens",
    },
    "edofsim.optics.lenses.base:Lens",
)
OBJECTS: Registry[type[KindModel]] = Registry(
    "edofsim.builders",
    "object",
    {
        "panel": "edofsim.scene.builders.basic:Panel",
        "box": "edofsim.scene.builders.basic:Box",
        "sphere": "edofsim.scene.builders.basic:Sphere",
        "cylinder": "edofsim.scene.builders.basic:Cylinder",
        "mug": "edofsim.scene.builders.basic:Mug",
        "goblet": "edofsim.scene.builders.basic:Goblet",
        "prism": "edofsim.scene.builders.basic:Prism",
        "book": "edofsim.scene.builders.stationery:Book",
        "pencil": "edofsim.scene.builders.stationery:Pencil",
        "wire": "edofsim.scene.builders.stationery:Wire",
        "bust": "edofsim.scene.builders.bust:Bust",
        "bus": "edofsim.scene.builders.vehicles:Bus",
        "car": "edofsim.scene.builders.vehicles:Car",
        "usaf_chart": "edofsim.scene.builders.targets:UsafChart",
        "color_checker": "edofsim.scene.builders.targets:ColorChecker",
        "text_page": "edofsim.scene.builders.stationery:TextPage",
        "mesh": "edofsim.scene.builders.imported:MeshFile",
        "table": "edofsim.scene.builders.room:Table",
        "wall": "edofsim.scene.builders.room:Wall",
        "hallway": "edofsim.scene.builders.hallway:Hallway",
        "facade": "edofsim.scene.builders.landscape:Facade",
        "foliage": "edofsim.scene.builders.landscape:Foliage",
        "hills": "edofsim.scene.builders.landscape:Hills",
        "clouds": "edofsim.scene.builders.landscape:CloudBank",
    },
    "edofsim.scene.builders.context:Builder",
)

SOURCES: Registry[type[KindModel]] = Registry(
    "edofsim.readers",
    "source",
    {
        "rgbd": "edofsim.render.readers.files:RgbdSource",
        "cube": "edofsim.render.readers.files:CubeSource",
        "mitsuba": "edofsim.scene.foreign:MitsubaSource",
    },
    "edofsim.recipe.sources:Source",
)
TRAINING_DATA: Registry[type[KindModel]] = Registry(
    "edofsim.training_data",
    "source of training data",
    {
        "natural": "edofsim.learn.photographs:NaturalImages",
        "packaged": "edofsim.learn.photographs:PackagedImages",
        "drawn": "edofsim.learn.drawn:DrawnSheets",
        "rendered": "edofsim.learn.rendered:RenderedPictures",
        "views": "edofsim.learn.views:Views",
    },
    "edofsim.learn.reader:TrainingReader",
)
SENSOR_EFFECTS: Registry[type[KindModel]] = Registry(
    "edofsim.sensor_effects",
    "sensor effect",
    {
        "bayer-mosaic": "edofsim.capture.sensor.mosaic:Mosaic",
        "shot-noise": "edofsim.capture.sensor.shot_noise:ShotNoise",
        "read-noise": "edofsim.capture.sensor.read_noise:ReadNoise",
        "saturation": "edofsim.capture.sensor.saturation:Saturation",
        "quantisation": "edofsim.capture.sensor.quantisation:Quantisation",
    },
    "edofsim.capture.sensor.base:SensorEffect",
)
NETWORKS: Registry[type[object]] = Registry(
    "edofsim.networks",
    "network",
    {
        "dcnn": "edofsim.restore.dcnn:DCnn",
        "local-unet": "edofsim.restore.local_unet:LocalUNet",
        "filter-bank": "edofsim.restore.filter_bank:FilterBank",
        "camera-bank": "edofsim.restore.camera_bank:CameraBank",
        "wiener": "edofsim.restore.wiener_network:WienerNetwork",
        "own": "edofsim.restore.own_network:OwnNetwork",
    },
    "edofsim.restore.restorer:Restorer",
)


class NameOf:
    """Annotation of a field that holds a name of a registry."""

    def __init__(self, registry: Registry[type[object]]) -> None:
        self.registry = registry

    def _known(self, name: str) -> str:
        if name not in self.registry:
            raise ValueError(self.registry.unknown(name))
        return name

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._known, core_schema.str_schema())

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return handler(core_schema.literal_schema(list(self.registry)))


class OfKind:
    """Annotation of a field that holds a model of any kind of a registry.

    usual: the kind of a table that names none; without it, such a table is refused.
    """

    def __init__(self, registry: Registry[type[KindModel]], usual: str | None = None) -> None:
        self.registry = registry
        self.usual = usual

    def model(self, kind: str) -> type[KindModel]:
        """The model of a kind. Raises InputError for what another package added and is none."""
        return self.registry[kind]

    def kind_of(self, data: object) -> str | None:
        """The kind that a table as it was read asks for; None where it asks for none that there is."""
        kind = data.get("kind", self.usual) if isinstance(data, Mapping) else None
        return kind if isinstance(kind, str) and kind in self.registry else None

    def _validated(self, value: object, info: ValidationInfo) -> KindModel:
        if isinstance(value, KindModel):
            if value.kind in self.registry and isinstance(value, self.model(value.kind)):
                return value
            raise PydanticKnownError("model_type", {"class_name": self.registry.kind})
        if not isinstance(value, Mapping):
            raise PydanticKnownError("dict_type")
        kind = self.kind_of(value)
        if kind is not None:
            return self.model(kind).model_validate({"kind": kind, **value}, context=info.context)
        if "kind" not in value:
            raise PydanticKnownError("union_tag_not_found", {"discriminator": "'kind'"})
        known = ", ".join(repr(name) for name in self.registry)
        given = {"discriminator": "'kind'", "tag": str(value["kind"]), "expected_tags": known}
        raise PydanticKnownError("union_tag_invalid", given)

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validated)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        kinds = {kind: self.model(kind).__pydantic_core_schema__ for kind in self.registry}
        return handler(core_schema.tagged_union_schema(kinds, "kind"))


def named(kind: str) -> Any:  # pyrefly: ignore[explicit-any] - pydantic validates it to the field's type
    """A field's default that only names a kind: the model is imported where a recipe has no such table."""
    return {"kind": kind}


AnyLens = Annotated[KindModel, OfKind(LENSES, usual="plano-convex")]
AnyMask = Annotated[KindModel, OfKind(MASKS)]
AnySensorEffect = Annotated[KindModel, OfKind(SENSOR_EFFECTS)]
