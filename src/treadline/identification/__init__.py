"""System identification: a linear state-space model from recorded belt speeds and motion."""

from treadline.identification._era import era
from treadline.identification._fitting import CandidateScore
from treadline.identification._from_gram import okid, pbsid
from treadline.identification._gram import Gram, gram_of
from treadline.identification._identified import IdentificationReport, Identified
from treadline.identification._okid import observer_markov, system_markov
from treadline.identification._stream import identify_chunks
from treadline.identification.identify import identify
from treadline.identification.options import METHODS, SOLVERS, IdentificationOptions
