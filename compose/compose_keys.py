"""Every key that a Compose file may have, besides those that begin with `x-` (Compose Specification)."""

_SERVICE = """
annotations attach blkio_config build cap_add cap_drop cgroup cgroup_parent command configs container_name cpu_count
cpu_percent cpu_period cpu_quota cpu_rt_period cpu_rt_runtime cpu_shares cpus cpuset credential_spec depends_on deploy
develop device_cgroup_rules devices dns dns_opt dns_search domainname entrypoint env_file environment expose extends
external_links extra_hosts gpus group_add healthcheck hostname image init ipc isolation label_file labels links logging
mac_address mem_limit mem_reservation mem_swappiness memswap_limit models network_mode networks oom_kill_disable
oom_score_adj pid pids_limit platform ports post_start pre_stop privileged profiles provider pull_policy read_only
restart runtime scale secrets security_opt shm_size stdin_open stop_grace_period stop_signal storage_opt sysctls tmpfs
tty ulimits use_api_socket user userns_mode uts volumes volumes_from working_dir
"""
_TABLES = "configs networks secrets volumes"
_TOP = f"{_TABLES} include models name services version"

SERVICE = frozenset(_SERVICE.split())
"""Of a service."""
TOP = frozenset(_TOP.split())
"""Of the file."""
TABLES = tuple(_TABLES.split())
"""Those of the file that are tables of what services refer to."""
