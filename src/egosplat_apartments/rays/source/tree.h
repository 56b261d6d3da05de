// A tree of bounding boxes around triangles, with four branches per node.
//
// It only skips triangles that a ray cannot hit: boxes are enlarged by more than the rounding error of the box test,
// which uses float32. So the result is the same as testing all triangles.
#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "triangles.h"

namespace rays {

typedef float Four __attribute__((vector_size(16)));
typedef int32_t FourInts __attribute__((vector_size(16)));

constexpr float INF = std::numeric_limits<float>::infinity();
constexpr int LEAF = 4, BINS = 16, DEEPEST = 60;
// Factor on the far end of a box test, and enlargement of boxes as a fraction of the largest coordinate.
constexpr float SLACK = 1 + 1e-6f, MARGIN = 1e-6f;

struct Box {
    std::array<float, 3> low{INF, INF, INF}, high{-INF, -INF, -INF};

    void add(const Box& other) {
        for (int axis = 0; axis < 3; axis++) {
            low[axis] = std::min(low[axis], other.low[axis]);
            high[axis] = std::max(high[axis], other.high[axis]);
        }
    }
    float area() const {
        const float x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
        return x < 0 ? 0 : x * y + y * z + z * x;
    }
};

struct Node {
    Four low[3], high[3];
    // Start of each branch: the number of a node, or the first triangle of a leaf. Triangles in a leaf; 0 for a node.
    int32_t begin[4], count[4];
};

struct Item {
    Box box;
    std::array<float, 3> middle;
    int32_t face;
};

class Tree {
    std::vector<Node> nodes;
    std::vector<Triangle> triangles;
    float margin = 0;

    struct Range {
        int begin, end;
        Box box;
        int size() const { return end - begin; }
    };

    static Range range(const std::vector<Item>& items, int begin, int end) {
        Range r{begin, end, {}};
        for (int i = begin; i < end; i++) r.box.add(items[i].box);
        return r;
    }

    // The split of a range: the cheapest of BINS - 1 planes along the axis with the widest spread of centers.
    static int part(std::vector<Item>& items, const Range& r) {
        Box spread;
        for (int i = r.begin; i < r.end; i++) spread.add({items[i].middle, items[i].middle});
        int axis = 0;
        for (int k = 1; k < 3; k++)
            if (spread.high[k] - spread.low[k] > spread.high[axis] - spread.low[axis]) axis = k;
        const float low = spread.low[axis], width = spread.high[axis] - low;
        const int half = r.begin + r.size() / 2;
        if (!(width > 0)) return half;
        const auto bin = [&](const Item& item) {
            return std::min(BINS - 1, int((item.middle[axis] - low) / width * BINS));
        };
        Box boxes[BINS];
        int counts[BINS] = {};
        for (int i = r.begin; i < r.end; i++) {
            const int b = bin(items[i]);
            boxes[b].add(items[i].box), counts[b]++;
        }
        float cost[BINS] = {}, least = INF;
        Box box;
        for (int b = BINS - 1, count = 0; b > 0; b--) {
            box.add(boxes[b]), count += counts[b];
            cost[b] = box.area() * count;
        }
        box = {};
        int best = 0;
        for (int b = 1, count = 0; b < BINS; b++) {
            box.add(boxes[b - 1]), count += counts[b - 1];
            const float sum = cost[b] + box.area() * count;
            if (count > 0 && count < r.size() && sum < least) least = sum, best = b;
        }
        if (best == 0) return half;
        const auto middle = std::partition(items.begin() + r.begin, items.begin() + r.end,
                                           [&](const Item& item) { return bin(item) < best; });
        return int(middle - items.begin());
    }

    int grow(std::vector<Item>& items, const Range& all, int depth) {
        Range parts[4] = {all};
        int used = 1;
        while (used < 4) {
            int largest = -1;
            for (int k = 0; k < used; k++)
                if (parts[k].size() > LEAF && (largest < 0 || parts[k].box.area() > parts[largest].box.area())) largest = k;
            if (largest < 0) break;
            const Range whole = parts[largest];
            // Deep nodes are split in halves, which bounds the stack of a ray.
            const int middle = depth < 24 ? part(items, whole) : whole.begin + whole.size() / 2;
            parts[largest] = range(items, whole.begin, middle);
            parts[used++] = range(items, middle, whole.end);
        }
        const int number = int(nodes.size());
        nodes.emplace_back();
        for (int k = 0; k < 4; k++) {
            const Range& r = parts[k];
            const bool there = k < used && r.size() > 0, leaf = there && r.size() <= LEAF;
            int begin = -1;
            if (there) begin = leaf ? r.begin : grow(items, r, depth + 1);
            Node& node = nodes[number];
            for (int axis = 0; axis < 3; axis++) {
                // A missing branch gets a box that no ray meets.
                node.low[axis][k] = there ? r.box.low[axis] - margin : INF;
                node.high[axis][k] = there ? r.box.high[axis] + margin : INF;
            }
            node.begin[k] = begin, node.count[k] = leaf ? r.size() : 0;
        }
        return number;
    }

public:
    Tree(const float* vertices, const int32_t* faces, int64_t count) {
        std::vector<Item> items(count);
        float largest = 0;
        for (int64_t i = 0; i < count; i++) {
            Item& item = items[i];
            item.face = int32_t(i);
            for (int k = 0; k < 3; k++) {
                const float* at = vertices + 3 * int64_t(faces[3 * i + k]);
                const std::array<float, 3> corner{at[0], at[1], at[2]};
                item.box.add({corner, corner});
                for (float x : corner) largest = std::max(largest, std::fabs(x));
            }
            for (int axis = 0; axis < 3; axis++) item.middle[axis] = 0.5f * (item.box.low[axis] + item.box.high[axis]);
        }
        margin = MARGIN * largest + 1e-30f;
        nodes.reserve(count / 2 + 1);
        grow(items, range(items, 0, int(count)), 0);
        triangles.resize(count);
        for (int64_t i = 0; i < count; i++) {
            triangles[i].face = items[i].face;
            for (int k = 0; k < 3; k++)
                for (int axis = 0; axis < 3; axis++)
                    triangles[i].corners[k][axis] = vertices[3 * int64_t(faces[3 * int64_t(items[i].face) + k]) + axis];
        }
    }

    // The nearest hit up to a distance; with `any`, the first hit found, whose face is valid only in its sign.
    Hit cast(const float* origin, const float* direction, double reach, bool any) const {
        const Ray ray(origin, direction);
        Hit best{reach, 0, 0, -1};
        float inverse[3];
        for (int axis = 0; axis < 3; axis++) {
            const float d = direction[axis];
            // A ray parallel to a side of the box: far away, not infinite, because 0 times infinity is NaN.
            inverse[axis] = 1 / (std::fabs(d) > 1e-18f ? d : std::copysign(1e-18f, d));
        }
        struct Entry {
            int32_t node;
            float near;
        } stack[4 * DEEPEST];
        int top = 0;
        stack[top++] = {0, 0};
        while (top > 0) {
            const Entry entry = stack[--top];
            if (entry.near > best.distance) continue;
            const Node& node = nodes[entry.node];
            Four near = {0, 0, 0, 0}, far = Four{0, 0, 0, 0} + float(std::min(best.distance, 3e38));
            for (int axis = 0; axis < 3; axis++) {
                const Four a = (node.low[axis] - origin[axis]) * inverse[axis];
                const Four b = (node.high[axis] - origin[axis]) * inverse[axis];
                const Four enter = inverse[axis] > 0 ? a : b, leave = inverse[axis] > 0 ? b : a;
                near = enter > near ? enter : near;
                far = leave < far ? leave : far;
            }
            const FourInts met = near <= far * SLACK;
            const int first = top;
            for (int k = 0; k < 4; k++) {
                if (!met[k] || node.begin[k] < 0) continue;
                if (node.count[k] == 0) {
                    stack[top++] = {node.begin[k], near[k] * (1 / SLACK)};
                    continue;
                }
                for (int i = 0; i < node.count[k]; i++) meet(ray, triangles[node.begin[k] + i], best);
                if (any && best.face >= 0) return best;
            }
            // Visit the nearest branch first.
            std::sort(stack + first, stack + top, [](const Entry& a, const Entry& b) { return a.near > b.near; });
        }
        return best;
    }
};

}  // namespace rays
