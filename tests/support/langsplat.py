"""LangSplat's protocol of queries, used by the paper."""

from egosplat.query.options import QueryOptions

LANGSPLAT = QueryOptions(min_score=0.5, size_weight=0.0)
