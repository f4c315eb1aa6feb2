# A shop's server:
#   docker build -t pinotwin .
#   docker run --rm -v "$PWD:/work" pinotwin check mill monday.csv
FROM python:3.11-slim
COPY . /src
RUN python -m pip install --no-cache-dir --no-compile -c /src/constraints.txt /src
RUN useradd --create-home --uid 1000 pinotwin
USER pinotwin
ENV OPENBLAS_NUM_THREADS=1 NUMBA_CACHE_DIR=/tmp/numba
WORKDIR /work
ENTRYPOINT ["pinotwin"]
