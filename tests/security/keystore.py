"""Makes a keystore of the form that `ros2 security create_keystore` and `create_enclave` give it, with openssl; for check.py.

    keystore.py FOLDER DOMAIN ENCLAVE[:DENIED_SERVICE...] ...

An enclave may publish, subscribe, call and serve everything; the services named after it it may neither call nor serve.
"""

import datetime
import os
import pathlib
import subprocess
import sys

XML = 'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_'


def openssl(*arguments):
    done = subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"keystore: openssl {arguments[0]}: {done.stderr.strip()}")
    return done.stdout


def certificate(folder, name, subject, constraints, days, issuer=None):
    """A key on prime256v1 and its certificate, signed by itself or by (certificate, key)."""
    key, cert = folder / f"{name}key.pem", folder / f"{name}cert.pem"
    openssl("genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-out", key)
    request, extensions = folder / "request", folder / "extensions"
    # A name such as /robot/arm has slashes, at which -subj would part it.
    extensions.write_text(f"[req]\nprompt=no\ndistinguished_name=dn\n[dn]\nCN={subject}\n[v3]\nbasicConstraints={constraints}\n")
    openssl("req", "-new", "-key", key, "-config", extensions, "-out", request)
    signer = ("-CA", issuer[0], "-CAkey", issuer[1], "-CAcreateserial", "-CAserial", folder / "serial") if issuer else ("-signkey", key)
    openssl("x509", "-req", "-in", request, "-sha256", "-days", days, "-extfile", extensions, "-extensions", "v3", "-out", cert, *signer)
    for left in ("request", "extensions", "serial"):
        (folder / left).unlink(missing_ok=True)
    return cert, key


def sign(authority, xml, signed):
    openssl("smime", "-sign", "-text", "-md", "sha256", "-in", xml, "-out", signed, "-signer", authority[0], "-inkey", authority[1])


def governance(domain):
    """What sros2 writes: everything is encrypted, messages as a whole are signed, nobody is let in without credentials."""
    access = "".join(f"<enable_{what}>true</enable_{what}>" for what in (
        "discovery_protection", "liveliness_protection", "read_access_control", "write_access_control"))
    return (f'<?xml version="1.0" encoding="UTF-8"?>\n<dds {XML}governance.xsd">\n<domain_access_rules>\n<domain_rule>\n'
            f"<domains><id>{domain}</id></domains>\n<allow_unauthenticated_participants>false</allow_unauthenticated_participants>\n"
            "<enable_join_access_control>true</enable_join_access_control>\n"
            "<discovery_protection_kind>ENCRYPT</discovery_protection_kind>\n<liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>\n"
            f"<rtps_protection_kind>SIGN</rtps_protection_kind>\n<topic_access_rules>\n<topic_rule><topic_expression>*</topic_expression>{access}"
            "<metadata_protection_kind>ENCRYPT</metadata_protection_kind><data_protection_kind>ENCRYPT</data_protection_kind></topic_rule>\n"
            "</topic_access_rules>\n</domain_rule>\n</domain_access_rules>\n</dds>\n")


def rule(kind, domain, topics):
    listed = "<topics>" + "".join(f"<topic>{topic}</topic>" for topic in topics) + "</topics>"
    return f"<{kind}>\n<domains><id>{domain}</id></domains>\n<publish>{listed}</publish>\n<subscribe>{listed}</subscribe>\n</{kind}>\n"


def permissions(enclave, domain, denied, cert):
    """As sros2 translates its policies: topics rt/, services rq/ and rr/, actions; a deny rule stands before what it is taken from."""
    valid = dict(line.split("=", 1) for line in openssl("x509", "-in", cert, "-noout", "-startdate", "-enddate").splitlines())
    begin, end = (datetime.datetime.strptime(valid[which], "%b %d %H:%M:%S %Y GMT").isoformat() for which in ("notBefore", "notAfter"))
    everything = ["rq/*/_action/cancel_goalRequest", "rq/*/_action/get_resultRequest", "rq/*/_action/send_goalRequest", "rq/*Request",
                  "rr/*/_action/cancel_goalReply", "rr/*/_action/get_resultReply", "rr/*/_action/send_goalReply", "rr/*Reply",
                  "rt/*", "rt/*/_action/feedback", "rt/*/_action/status"]
    rules = rule("deny_rule", domain, [f"{way}{service}{part}" for service in denied for way, part in (("rq", "Request"), ("rr", "Reply"))]) if denied else ""
    rules += rule("allow_rule", domain, everything) + rule("allow_rule", domain, ["ros_discovery_info"])
    return (f'<dds {XML}permissions.xsd">\n<permissions>\n<grant name="{enclave}">\n<subject_name>CN={enclave}</subject_name>\n'
            f"<validity><not_before>{begin}</not_before><not_after>{end}</not_after></validity>\n{rules}<default>DENY</default>\n"
            "</grant>\n</permissions>\n</dds>\n")


def link(path, target):
    path.symlink_to(os.path.relpath(target, path.parent))


def make(keystore, domain, enclaves, days=3650):
    """`enclaves`: the services that each may not have, by the enclave's name. `days`: how long the enclaves' certificates hold."""
    public, private, folders = (keystore / part for part in ("public", "private", "enclaves"))
    for folder in (public, private, folders):
        folder.mkdir(parents=True)
    certificate(public, "ca.", "sros2CA", "critical,CA:TRUE,pathlen:1", 3650)
    (public / "ca.key.pem").rename(private / "ca.key.pem")
    for use in ("identity", "permissions"):
        link(public / f"{use}_ca.cert.pem", public / "ca.cert.pem")
        link(private / f"{use}_ca.key.pem", private / "ca.key.pem")
    authority = public / "ca.cert.pem", private / "ca.key.pem"
    (folders / "governance.xml").write_text(governance(domain))
    sign(authority, folders / "governance.xml", folders / "governance.p7s")
    for enclave, denied in enclaves.items():
        folder = folders / enclave.strip("/")
        folder.mkdir(parents=True)
        for use in ("identity", "permissions"):
            link(folder / f"{use}_ca.cert.pem", public / f"{use}_ca.cert.pem")
        link(folder / "governance.p7s", folders / "governance.p7s")
        cert, _ = certificate(folder, "", enclave, "CA:FALSE", days, authority)
        (folder / "permissions.xml").write_text(permissions(enclave, domain, denied, cert))
        sign(authority, folder / "permissions.xml", folder / "permissions.p7s")
    return keystore


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    make(pathlib.Path(sys.argv[1]), int(sys.argv[2]), {name.split(":")[0]: name.split(":")[1:] for name in sys.argv[3:]})
