"""One run and its one owner: ``resolve`` reads each file once, an episode drives the chair, scores judge it by ground truth."""
