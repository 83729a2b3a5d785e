// An animation's space basis, and what is made beside the reference frame that it stands on.
#include <latch>
#include <thread>

#include "decode/animation.hpp"
#include "mesh/curves.hpp"

namespace pdeanim {

namespace {

// Peak memory of an element: its node and the one above, their functions, how the two go together, the reference frame.
constexpr u64 bytes_per_element = 2048;

// Of the memory that is left, functions of space are kept where they take no more than one of so many shares.
constexpr u64 memory_shares = 8;

}  // namespace

// Whether section REST says which vertices coincide; some may where it does not.
bool Animation::says_welds() const {
    constexpr u64 predictor_offset = 32;
    const SectionEntry &entry = container_.entry("REST");
    std::vector<u8> predictor;
    if (entry.length > predictor_offset) container_.read_range(entry.offset + predictor_offset, 1, predictor);
    return !predictor.empty() && predictor[0] % 2 == 1;
}

std::shared_ptr<const SpaceLayout> Animation::layout_of(std::shared_ptr<const Patches> patches) const {
    return std::make_shared<const SpaceLayout>(SpaceLayout::of_bytes(model_.form, std::move(patches), model_.layout));
}

// What they take, and the making of their functions by each thread.
TakenMemory Animation::take_elements(const Patches &patches) {
    i64 largest = 0;
    for (i64 e = 0; e < patches.count(); ++e) largest = most(largest, patches.size(e));
    const u64 making = ElementFunctions::bytes(largest, model_.form.functions) * static_cast<u64>(threads_);
    return TakenMemory(memory_, bytes_per_element * static_cast<u64>(patches.count()) + making, "patches of vertices");
}

// Patches as they are unless vertices coincide, made beside the reference frame; then go on with coefficients.
struct Animation::Early {
    std::shared_ptr<Patches> patches;  // none where a vertex has no neighbour
    TakenMemory taken;
    std::shared_ptr<const SpaceLayout> layout;
    std::exception_ptr failure;
    std::latch made{1};
    std::jthread thread;  // where nothing else is decoded ahead
};

// Begin with them; nothing where they would not be the patches, or there is no thread for it.
std::shared_ptr<Animation::Early> Animation::begin_early(GroupsAhead *ahead) {
    if (threads_ < 2 || reference_ || says_welds()) return nullptr;
    auto early = std::make_shared<Early>();
    const auto make = [this, ahead, own = early.get(), parts = views()] {
        GroupCoefficients *coefficients = nullptr;
        try {
            own->patches = early_patches(parts, model_.form.points);
            if (own->patches) {
                own->taken = take_elements(*own->patches);
                own->layout = layout_of(own->patches);
            }
            if (own->layout && ahead) {
                coefficients = ahead->make_coefficients(own->layout, own->taken.another());
            }
        } catch (const CorruptError &) {
            // They may not be the patches.
        } catch (...) {
            own->failure = std::current_exception();
        }
        own->made.count_down();
        if (coefficients) coefficients->decode();
    };
    if (ahead) {
        ahead->insert([make, early] { make(); });
    } else {
        early->thread = std::jthread(make);
    }
    return early;
}

// `ahead`: goes on with coefficients as soon as it is known where they belong.
const SpaceBasis &Animation::space(GroupsAhead *ahead) {
    const std::lock_guard guard(lock_);
    if (!space_) {
        const SpaceForm &form = model_.form;
        const std::vector<ConnectivityView> parts = views();
        std::shared_ptr<const SpaceLayout> layout;
        if (form.kind == SpaceKind::patch) {
            // Unless vertices coincide, patches follow from connectivity alone: they are made while the reference frame is
            // decoded, and so are coefficients.
            const std::shared_ptr<Early> early = begin_early(ahead);
            reference();
            if (early) early->made.wait();
            if (early && early->failure) std::rethrow_exception(early->failure);
            std::shared_ptr<Patches> patches =
                build_patches(parts, reference().grid, form.points, early ? early->patches : nullptr);
            if (early && early->layout && patches == early->patches) {
                layout = early->layout;
                of_elements_ = std::move(early->taken);
            } else {
                if (ahead) ahead->drop_coefficients();
                of_elements_ = take_elements(*patches);
                layout = layout_of(std::move(patches));
            }
        } else {
            Curves curves = extract_curves(parts, reference().grid);
            auto pieces =
                std::make_shared<const Patches>(cut_curves(std::move(curves.order), curves.starts, form.points));
            of_elements_ = take_elements(*pieces);
            layout = layout_of(std::move(pieces));
        }
        // Whoever waited for a thread that finds no processor would wait for those that are busy.
        const int threads = most(threads_ - (ahead ? ahead->busy() : 0), 1);
        space_ = std::make_unique<SpaceBasis>(std::move(layout), reference().grid, threads);
        const u64 bytes = static_cast<u64>(space_->bytes_to_keep());
        if (table_->groups().size() > 1 && bytes <= memory_.left() / memory_shares) {
            memory_.take(bytes, "functions of space");
            space_->keep_functions();
        }
    }
    return *space_;
}

}  // namespace pdeanim
