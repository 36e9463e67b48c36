"""Kernels that pair features and judge the relative poses these pairs imply."""

from math import atan, cos, exp, floor, hypot, pi, sin, sqrt

from numba import njit


@njit(cache=True)
def _wrap(angle):
    return angle - 2.0 * pi * floor((angle + pi) / (2.0 * pi))


@njit(cache=True)
def merge_features(kinds, rows, n, pose, radius, map_kinds, map_rows, hits, m):
    """Move n features by `pose` into the map frame and merge each with an equal one within `radius`; return map size."""
    c, s = cos(pose[2]), sin(pose[2])
    for i in range(n):
        x = pose[0] + c * rows[i, 0] - s * rows[i, 1]
        y = pose[1] + s * rows[i, 0] + c * rows[i, 1]
        d0, d1 = rows[i, 2] + pose[2], rows[i, 3] + pose[2]
        found = -1
        for k in range(m):
            if map_kinds[k] != kinds[i]:
                continue
            if abs(map_rows[k, 0] - x) > radius or abs(map_rows[k, 1] - y) > radius:
                continue
            ok = True
            for col in range(2):
                d = d0 if col == 0 else d1
                e = map_rows[k, 2 + col]
                if (d == d) != (e == e) or (d == d and abs(_wrap(d - e)) > 0.3):
                    ok = False
            if ok:
                found = k
                break
        if found >= 0:
            w = 1.0 / (hits[found] + 1.0)
            map_rows[found, 0] += w * (x - map_rows[found, 0])
            map_rows[found, 1] += w * (y - map_rows[found, 1])
            if d0 == d0:
                map_rows[found, 2] += w * _wrap(d0 - map_rows[found, 2])
            if d1 == d1:
                map_rows[found, 3] += w * _wrap(d1 - map_rows[found, 3])
            hits[found] += 1.0
            map_rows[found, 8] = max(map_rows[found, 8], rows[i, 8])
            map_rows[found, 9] = min(map_rows[found, 9], rows[i, 9])
        elif m < len(map_kinds):
            map_kinds[m] = kinds[i]
            map_rows[m, 0], map_rows[m, 1], map_rows[m, 2], map_rows[m, 3] = x, y, d0, d1
            cxx, cxy, cyy = rows[i, 4], rows[i, 5], rows[i, 6]
            map_rows[m, 4] = c * c * cxx - 2.0 * c * s * cxy + s * s * cyy
            map_rows[m, 5] = c * s * (cxx - cyy) + (c * c - s * s) * cxy
            map_rows[m, 6] = s * s * cxx + 2.0 * c * s * cxy + c * c * cyy
            map_rows[m, 7], map_rows[m, 8], map_rows[m, 9] = rows[i, 7], rows[i, 8], rows[i, 9]
            hits[m] = 1.0
            m += 1
    return m


@njit(cache=True)
def pair_hypotheses(kinds, rows, n, ref_kinds, ref_rows, m, guess, window_t, window_r, opening, out):
    """One relative pose for every pair of features that passes the hierarchy of filters; return their count."""
    count = 0
    for i in range(n):
        x, y = rows[i, 0], rows[i, 1]
        for j in range(m):
            # types: the same, or a corner one of whose walls (or the corner itself) was hidden
            if kinds[i] != ref_kinds[j] and kinds[i] != 0 and ref_kinds[j] != 0:
                continue
            # feasible area around where the guess puts the feature, then direction and opening angle
            a0, a1 = ref_rows[j, 2] - rows[i, 2], ref_rows[j, 3] - rows[i, 3]
            if a0 == a0:
                a0 = _wrap(a0)
                turn = a0
                if a1 == a1:
                    d = _wrap(a1 - a0)
                    if abs(d) > opening:
                        continue
                    turn = _wrap(a0 + 0.5 * d)
            elif a1 == a1:
                turn = _wrap(a1)
            else:
                continue
            if abs(_wrap(turn - guess[2])) > window_r:
                continue
            c, s = cos(turn), sin(turn)
            tx = ref_rows[j, 0] - c * x + s * y
            ty = ref_rows[j, 1] - s * x - c * y
            if abs(tx - guess[0]) > window_t or abs(ty - guess[1]) > window_t:
                continue
            if count >= len(out):
                return count
            out[count, 0], out[count, 1], out[count, 2] = tx, ty, turn
            count += 1
    return count


@njit(cache=True)
def score_hypotheses(points, picks, hypotheses, count, distance2, origin, cell, sigma, scores):
    """Mean of exp(-d²/2σ²) over the picked points, d from the coarse field."""
    ny, nx = distance2.shape
    k = -0.5 / (sigma * sigma)
    for h in range(count):
        c, s = cos(hypotheses[h, 2]), sin(hypotheses[h, 2])
        x0, y0 = (hypotheses[h, 0] - origin[0]) / cell, (hypotheses[h, 1] - origin[1]) / cell
        total = 0.0
        for q in range(len(picks)):
            px, py = points[picks[q], 0] / cell, points[picks[q], 1] / cell
            u = int(floor(x0 + c * px - s * py))
            v = int(floor(y0 + s * px + c * py))
            if 0 <= u < nx and 0 <= v < ny:
                total += exp(k * distance2[v, u])
        scores[h] = total / max(1, len(picks))


@njit(cache=True)
def _coincidence(kinds, rows, i, x, y, turn, ref_kinds, ref_rows, m):
    """Nearest reference feature that feature i, moved to x, y, may be; return index, squared distance, angle."""
    gate = rows[i, 9] / 50.0 + 0.1
    best, best_d2, best_angle = -1, gate * gate, 0.0
    for j in range(m):
        dx, dy = ref_rows[j, 0] - x, ref_rows[j, 1] - y
        if abs(dx) > gate or abs(dy) > gate:
            continue
        d2 = dx * dx + dy * dy
        if d2 > best_d2 or (kinds[i] != ref_kinds[j] and kinds[i] != 0 and ref_kinds[j] != 0):
            continue
        a0 = ref_rows[j, 2] - rows[i, 2] - turn
        a1 = ref_rows[j, 3] - rows[i, 3] - turn
        angle, known = 0.0, False
        if a0 == a0:
            angle, known = abs(_wrap(a0)), True
        if a1 == a1:
            angle, known = max(angle, abs(_wrap(a1))), True
        if not known or angle > 0.35:
            continue
        best, best_d2, best_angle = j, d2, angle
    return best, best_d2, best_angle


@njit(cache=True)
def _importance(distance):
    """Equation (3): what a feature at this distance from the laser is worth."""
    return 0.6 - 0.4 * atan(0.2 * distance - 0.2)


@njit(cache=True)
def _mahalanobis2(rows, i, c, s, ref, dx, dy, floor_variance):
    """Squared distance of two coinciding features under the sum of their covariances."""
    cxx, cxy, cyy = rows[i, 4], rows[i, 5], rows[i, 6]
    sxx = c * c * cxx - 2.0 * c * s * cxy + s * s * cyy + ref[4] + floor_variance
    sxy = c * s * (cxx - cyy) + (c * c - s * s) * cxy + ref[5]
    syy = s * s * cxx + 2.0 * c * s * cxy + c * c * cyy + ref[6] + floor_variance
    det = sxx * syy - sxy * sxy
    return (syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy) / det


@njit(cache=True)
def score_by_features(kinds, rows, n, ref_kinds, ref_rows, m, hypotheses, count, paper, counts, scores):
    """Number of coincidences of each hypothesis and its correlation (larger is better, in [0, 1]).

    paper: equations (1) and (2), as exp(-Σ(dis·P)/(count²·ΣP)) so that larger is better. Otherwise the mean over the
    new features of exp(-½ Mahalanobis²) with the covariances of both features.
    """
    for h in range(count):
        turn = hypotheses[h, 2]
        c, s = cos(turn), sin(turn)
        hit, weighted, weights, likelihood = 0, 0.0, 0.0, 0.0
        for i in range(n):
            x = hypotheses[h, 0] + c * rows[i, 0] - s * rows[i, 1]
            y = hypotheses[h, 1] + s * rows[i, 0] + c * rows[i, 1]
            j, d2, angle = _coincidence(kinds, rows, i, x, y, turn, ref_kinds, ref_rows, m)
            if j < 0:
                continue
            hit += 1
            if paper:
                p = sqrt(max(0.0, _importance(rows[i, 9])) * max(0.0, _importance(ref_rows[j, 9])))
                weighted += (sqrt(d2) + angle) * p
                weights += p
            else:
                far = _mahalanobis2(rows, i, c, s, ref_rows[j], ref_rows[j, 0] - x, ref_rows[j, 1] - y, 4e-4)
                far += angle * angle / (rows[i, 7] + ref_rows[j, 7] + 1e-3)
                likelihood += exp(-0.5 * far)
        counts[h] = hit
        if paper:
            scores[h] = exp(-weighted / (hit * hit * weights)) if weights > 0.0 else 0.0
        else:
            scores[h] = likelihood / max(1, n)


@njit(cache=True)
def polish_on_features(kinds, rows, n, ref_kinds, ref_rows, m, start, iterations, pose, hessian):
    """Gauss-Newton on coinciding features, each weighed by its covariances; return their number."""
    pose[0], pose[1], pose[2] = start[0], start[1], start[2]
    hit = 0
    for _ in range(iterations):
        c, s = cos(pose[2]), sin(pose[2])
        hessian[:] = 0.0
        g0, g1, g2 = 0.0, 0.0, 0.0
        hit = 0
        for i in range(n):
            rx, ry = c * rows[i, 0] - s * rows[i, 1], s * rows[i, 0] + c * rows[i, 1]
            x, y = pose[0] + rx, pose[1] + ry
            j, _d2, _angle = _coincidence(kinds, rows, i, x, y, pose[2], ref_kinds, ref_rows, m)
            if j < 0:
                continue
            hit += 1
            cxx, cxy, cyy = rows[i, 4], rows[i, 5], rows[i, 6]
            sxx = c * c * cxx - 2.0 * c * s * cxy + s * s * cyy + ref_rows[j, 4] + 4e-4
            sxy = c * s * (cxx - cyy) + (c * c - s * s) * cxy + ref_rows[j, 5]
            syy = s * s * cxx + 2.0 * c * s * cxy + c * c * cyy + ref_rows[j, 6] + 4e-4
            det = sxx * syy - sxy * sxy
            ixx, ixy, iyy = syy / det, -sxy / det, sxx / det
            ex, ey = x - ref_rows[j, 0], y - ref_rows[j, 1]
            far = ixx * ex * ex + 2.0 * ixy * ex * ey + iyy * ey * ey
            w = 1.0 / (1.0 + 0.25 * far)
            # derivative of the position with respect to the heading
            jx, jy = -ry, rx
            hessian[0, 0] += w * ixx
            hessian[0, 1] += w * ixy
            hessian[1, 1] += w * iyy
            hessian[0, 2] += w * (ixx * jx + ixy * jy)
            hessian[1, 2] += w * (ixy * jx + iyy * jy)
            hessian[2, 2] += w * (ixx * jx * jx + 2.0 * ixy * jx * jy + iyy * jy * jy)
            g0 += w * (ixx * ex + ixy * ey)
            g1 += w * (ixy * ex + iyy * ey)
            g2 += w * (jx * (ixx * ex + ixy * ey) + jy * (ixy * ex + iyy * ey))
            for col in range(2):
                a = ref_rows[j, 2 + col] - rows[i, 2 + col] - pose[2]
                if a == a:
                    a = _wrap(a)
                    i_a = w / (rows[i, 7] + ref_rows[j, 7] + 1e-3)
                    hessian[2, 2] += i_a
                    g2 -= i_a * a
        hessian[1, 0], hessian[2, 0], hessian[2, 1] = hessian[0, 1], hessian[0, 2], hessian[1, 2]
        if hit < 1:
            break
        h00, h01, h02 = hessian[0, 0] + 1e-6, hessian[0, 1], hessian[0, 2]
        h11, h12, h22 = hessian[1, 1] + 1e-6, hessian[1, 2], hessian[2, 2] + 1e-6
        a00, a01, a02 = h11 * h22 - h12 * h12, h02 * h12 - h01 * h22, h01 * h12 - h02 * h11
        a11, a12, a22 = h00 * h22 - h02 * h02, h01 * h02 - h00 * h12, h00 * h11 - h01 * h01
        det3 = h00 * a00 + h01 * a01 + h02 * a02
        s0 = -(a00 * g0 + a01 * g1 + a02 * g2) / det3
        s1 = -(a01 * g0 + a11 * g1 + a12 * g2) / det3
        s2 = -(a02 * g0 + a12 * g1 + a22 * g2) / det3
        pose[0] += s0
        pose[1] += s1
        pose[2] += s2
        if hypot(s0, s1) < 1e-4 and abs(s2) < 1e-5:
            break
    return hit
