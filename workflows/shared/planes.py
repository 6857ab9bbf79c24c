"""One variable of an ensemble against another, in the colours of its populations."""


def label(variable):
    """The symbol of a variable, or its name."""
    return variable.attrs.get("symbol", variable.name)


def plane(axes, ensemble, x, y, medians=False):
    """Draw a point for each member, with the label of its population, and on request large ones for the medians."""
    for name in ensemble.population.values:
        one = ensemble.sel(population=name)
        style = {"color": one.population_color.item()}
        axes.plot(one[x], one[y], ".", markersize=4, label=one.population_symbol.item(), **style)
        if medians:
            axes.plot(one[x].median(), one[y].median(), "o", markeredgecolor="k", **style)
    axes.set(xlabel=label(ensemble[x]), ylabel=label(ensemble[y]))
