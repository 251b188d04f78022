"""Tables of surveyed points as surveyors write them."""

import numpy as np
import pytest
from fresco.core.errors import ScanError
from fresco.core.pose.points.survey import read_survey


@pytest.mark.parametrize(
    "text",
    [
        "P1,5000000.25,1.5,2\nP2,3,4,5\n",
        "id;x;y;z\nP1;5000000,25;1,5;2\nP2;3;4;5\n",
        "# survey\nName\tNorthing\tEasting\tHeight\nP1\t1.5\t5000000.25\t2\nP2\t4\t3\t5\n",
        "P1 5000000.25  1.5 2\n\nP2   3 4 5",
        "code,Z [m],name,X [m],Y [m]\nq,2,P1,5000000.25,1.5\nq,5,P2,3,4\n",
    ],
)
def test_delimiters_headers_and_decimal_signs(tmp_path, text):
    path = tmp_path / "points.csv"
    path.write_text(text, encoding="utf-8")
    survey = read_survey(path)
    assert survey.names == ("P1", "P2")
    assert np.allclose(survey.points, [[5000000.25, 1.5, 2], [3, 4, 5]], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "empty"),
        ("P1;1;2\n", "line 1: a name and three coordinates are needed, not “P1;1;2”"),
        ("P1,1,2,3\nP2,1,here,3\n", "line 2: “here” is no number for y"),
        ("P1,1,2,3\nP1,1,2,4\n", "line 2: the point “P1” is there twice"),
        ("name,x,y,z\n", "no points"),
        ("P1,1,2,nan\n", "finite"),
    ],
)
def test_errors_name_the_line(tmp_path, text, sentence):
    path = tmp_path / "points.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ScanError, match=sentence):
        read_survey(path)


def test_missing_table_is_told(tmp_path):
    with pytest.raises(ScanError, match="cannot be read"):
        read_survey(tmp_path / "none.csv")
