"""The items of CLAIM 2024, the Checklist for Artificial Intelligence in Medical Imaging, in our own words."""

from __future__ import annotations

from experiments.studies.checklist.items import Item

SOURCE = (
    "A. S. Tejani et al., Checklist for Artificial Intelligence in Medical Imaging (CLAIM): 2024 Update, "
    "Radiology: Artificial Intelligence 6(4), e240300, 2024"
)
# Section, and what each of its items asks for; the numbers run on.
_SECTIONS = (
    (
        "Title and abstract",
        (
            "Say that it is a study of AI, and of which kind",
            "Abstract: design, methods, results and conclusions",
        ),
    ),
    (
        "Introduction",
        ("Background, and the role that the method is meant to have", "Aims, objectives and hypotheses"),
    ),
    ("Methods: design", ("Prospective or retrospective", "What the study is to achieve")),
    (
        "Methods: data",
        (
            "Where the data come from",
            "Who and what was included and excluded",
            "How the data were preprocessed",
            "How parts of the data were chosen",
            "How data were de-identified",
            "What was done about missing data",
            "How the images were acquired",
        ),
    ),
    (
        "Methods: reference standard",
        (
            "How the reference standard was obtained",
            "Why this reference standard",
            "Who annotated, with which qualification",
            "How the test set was annotated",
            "How much annotators differ, from each other and from themselves",
        ),
    ),
    (
        "Methods: partitions",
        ("How data were assigned to partitions", "At which level partitions share nothing"),
    ),
    ("Methods: test data", ("How many test data were planned, and why",)),
    (
        "Methods: model",
        ("The model in full", "Software with versions", "How parameters were initialised"),
    ),
    (
        "Methods: training",
        ("How the model was trained", "How the final model was chosen", "How models were combined"),
    ),
    (
        "Methods: evaluation",
        (
            "Metrics of performance",
            "Statistics: significance and uncertainty",
            "Robustness or sensitivity",
            "How results can be explained or interpreted",
            "Evaluation on internal data",
            "Test on external data",
            "Registration as a clinical trial",
        ),
    ),
    (
        "Results: data",
        (
            "Numbers of patients or examinations, included and excluded",
            "Demographic and clinical characteristics of each partition",
        ),
    ),
    (
        "Results: performance",
        (
            "Performance with its uncertainty",
            "Diagnostic performance with its precision",
            "Failure analysis",
        ),
    ),
    ("Discussion", ("Limitations", "What follows for practice")),
    (
        "Other information",
        (
            "Where the full protocol or further detail is",
            "What of software, model and data is available",
            "Funding and the funders' role",
        ),
    ),
)
ITEMS = tuple(
    Item(str(number), section, asks)
    for number, (section, asks) in enumerate(
        ((section, asks) for section, each in _SECTIONS for asks in each), start=1
    )
)
