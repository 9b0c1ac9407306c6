# docker build -t cwcli . && docker run --rm -v "$PWD:/drives" cwcli run drive.mcap -o annotated.mcap
# The first stage compiles; the image holds no compiler, and runs as nobody in particular.
FROM python:3.13-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends gcc libc6-dev
WORKDIR /src
COPY . .
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheel .

FROM python:3.13-slim
COPY --from=build /wheel /wheel
# The extras: pages, and files that are no logs.
RUN pip install --no-cache-dir "$(ls /wheel/*.whl)[report,import]" && rm -r /wheel && cwcli --version
RUN useradd --create-home driver
USER driver
WORKDIR /drives
ENTRYPOINT ["cwcli"]
CMD ["--help"]
