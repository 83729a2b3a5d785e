# The public names of the package, and where each is defined. `__init__.py` reads this list too, and loads a name on its
# first use: keep one name per line.
from pdecodec.codec.array_evaluator import ArrayEvaluator as ArrayEvaluator
from pdecodec.codec.checking import FileCheck as FileCheck
from pdecodec.codec.checking import check_file as check_file
from pdecodec.codec.decoder import Animation as Animation
from pdecodec.codec.editing import cut_animation as cut_animation
from pdecodec.codec.editing import join_animations as join_animations
from pdecodec.codec.encode.report import EncodeReport as EncodeReport
from pdecodec.codec.encoding import encode as encode
from pdecodec.codec.encoding import encode_to_rms as encode_to_rms
from pdecodec.codec.encoding import encode_to_size as encode_to_size
from pdecodec.codec.mending import Finding as Finding
from pdecodec.codec.opening import open_animation as open  # noqa: F401 - a public name
from pdecodec.codec.opening import open_animation as open_animation
from pdecodec.codec.paper_form import PaperForm as PaperForm
from pdecodec.codec.salvaging import Salvage as Salvage
from pdecodec.codec.salvaging import salvage as salvage
from pdecodec.codec.settings import EncodeSettings as EncodeSettings
from pdecodec.codec.settings import PaperSettings as PaperSettings
from pdecodec.codec.source import DecodeLimits as DecodeLimits
from pdecodec.errors import CorruptFileError as CorruptFileError
from pdecodec.errors import ErrorCode as ErrorCode
from pdecodec.errors import InputError as InputError
from pdecodec.errors import LimitError as LimitError
from pdecodec.errors import MissingExtraError as MissingExtraError
from pdecodec.errors import PdecodecError as PdecodecError
from pdecodec.errors import SettingsError as SettingsError
from pdecodec.formats import open_sequence as open_sequence
from pdecodec.formats import write_sequence as write_sequence
from pdecodec.formats.base.transforms import apply_transform as apply_transform
from pdecodec.formats.base.transforms import bake_transforms as bake_transforms
from pdecodec.mesh.fields import Field as Field
from pdecodec.mesh.runs import ChangingSequence as ChangingSequence
from pdecodec.mesh.selection import FrameSelection as FrameSelection
from pdecodec.mesh.selection import ObjectSelection as ObjectSelection
from pdecodec.mesh.sequence import ArraySequence as ArraySequence
from pdecodec.mesh.sequence import Attribute as Attribute
from pdecodec.mesh.sequence import Connectivity as Connectivity
from pdecodec.mesh.sequence import MeshObject as MeshObject
from pdecodec.mesh.sequence import MeshSequence as MeshSequence

__version__: str
