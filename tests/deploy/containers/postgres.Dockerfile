# In the place of postgres:15-bookworm: Debian's PostgreSQL, made by the same variables.
FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install --no-install-recommends --yes postgresql-common \
    && echo "create_main_cluster = false" > /etc/postgresql-common/createcluster.conf \
    && apt-get install --no-install-recommends --yes postgresql-15 \
    && install --directory --owner=postgres --group=postgres /var/lib/postgresql/data
ENV PATH=/usr/lib/postgresql/15/bin:$PATH PGDATA=/var/lib/postgresql/data
VOLUME /var/lib/postgresql/data
COPY postgres.sh /usr/local/bin/
ENTRYPOINT ["sh", "/usr/local/bin/postgres.sh"]
